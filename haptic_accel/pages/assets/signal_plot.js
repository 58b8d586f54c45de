// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plot of the acceleration of the board that a bring-up looks at, and its numbers.
import { axis, colour } from "./axes.js";
import { byId, digits, setText } from "./elements.js";
import { Limit, livePlot } from "./live_plot.js";

const DURATION = 0.5; // s that are shown
const LEAST = 2; // m/s², smallest limit of the axis
const NOTHING = [[-DURATION, 0], [null, null]];

const limit = new Limit(LEAST);
let isEmpty = true; // nothing is drawn, which need not be drawn again

/** The plot itself. */
export const signalPlot = livePlot(
  byId("signal"),
  {
    scales: {
      x: { time: false, range: () => [-DURATION, 0] },
      y: { range: () => [-limit.value, limit.value] },
    },
    series: [{}, { stroke: () => colour("actual"), width: 1.4, points: { show: false } }],
    axes: [axis("time (s)"), axis("acceleration (m/s²)", { size: 52 })],
  },
  NOTHING,
);

/** Show a signal: acceleration in m/s², null where samples are missing, and rate in Hz; null for none. */
export function showSignal(signal) {
  if (!signal) {
    setText(byId("signal-reading"), "no board is read now");
    if (!isEmpty) signalPlot.setData(NOTHING);
    isEmpty = true;
    return;
  }
  isEmpty = false;
  const { acceleration, missing, rate } = signal;
  const there = acceleration.filter((value) => value !== null);
  const [least, most] = [Math.min(...there), Math.max(...there)]; // infinite without samples
  const vibration = `vibration ${digits((most - least) / 2, 2)} m/s²`;
  setText(byId("signal-reading"), `${vibration}, ${rate} Hz, ${missing} of ${DURATION * rate} samples missing`);
  limit.meet(there.length ? Math.max(-least, most) : 0);
  const step = DURATION / acceleration.length;
  signalPlot.setData([acceleration.map((_, i) => (i + 1) * step - DURATION), acceleration]);
}
