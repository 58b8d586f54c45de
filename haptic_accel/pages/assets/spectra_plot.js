// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plot of the amplitude spectra of desired and actual acceleration.
import { axis, colour } from "./axes.js";
import { byId } from "./elements.js";
import { livePlot } from "./live_plot.js";

const LOWEST = 10; // Hz, where spectra begin
const HIGHEST = 500; // Hz, where the axis ends while there are none
const LEAST_TOP = 0.1; // m/s²/√Hz, lowest upper end of that axis; the sensors' noise is at its lower end
const DECADES = 3; // of the vertical axis

let top = 1; // m/s²/√Hz, upper end of the axis
const values = (u, splits) => splits.map((v) => (v === null ? "" : String(+v.toPrecision(1))));
const curve = (name, width) => ({ stroke: () => colour(name), width, points: { show: false } });

/** The plot itself. */
export const spectraPlot = livePlot(
  byId("spectra"),
  {
    scales: {
      x: { time: false, distr: 3, range: (u, least, most) => [LOWEST, most || HIGHEST] },
      y: { distr: 3, range: () => [top / 10 ** DECADES, top] },
    },
    series: [{}, curve("desired", 2), curve("actual", 1.4)],
    axes: [axis("frequency (Hz)"), axis("m/s²/√Hz", { size: 62, values })],
  },
  [[LOWEST, HIGHEST], [null, null], [null, null]],
);

/** Show spectra in m/s²/√Hz, desired and actual, at frequencies in Hz; nothing changes without any. */
export function showSpectra({ frequency, spectra }) {
  if (!frequency.length) return;
  const first = frequency.findIndex((f) => f >= LOWEST);
  const lines = spectra.map((values) => Array.from(values.subarray(first), (v) => (v > 0 ? v : null)));
  const wanted = 10 ** Math.ceil(Math.log10(Math.max(LEAST_TOP, ...lines.flat())));
  if (wanted > top || wanted < top / 10) top = wanted;
  spectraPlot.setData([Array.from(frequency.subarray(first)), ...lines]);
}
