// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plot of the desired against the actual acceleration, with the regression line.
import { axis, colour } from "./axes.js";
import { byId } from "./elements.js";
import { Limit, clipped, livePlot } from "./live_plot.js";

const SHARE = 0.97; // of the values that the scale is chosen for
const ROOM = 1.5; // margin of the scale beyond these values

const limit = new Limit(1); // m/s²
let cloud = null;

/** The plot itself. */
export const cloudPlot = livePlot(
  byId("cloud"),
  {
    scales: {
      x: { time: false, range: () => [-limit.value, limit.value] },
      y: { range: () => [-limit.value, limit.value] },
    },
    series: [{}, {}],
    axes: [axis("actual (m/s²)"), axis("desired (m/s²)", { size: 52 })],
    hooks: { draw: [drawLine] },
  },
  [[-1, 1], [null, null]],
);

function drawLine({ ctx, bbox: box }) {
  if (!cloud) return;
  clipped(ctx, box, () => {
    const most = limit.value;
    const x = (value) => box.left + (0.5 + value / (2 * most)) * box.width;
    const y = (value) => box.top + (0.5 - value / (2 * most)) * box.height;
    const line = (slope, stroke, width, dash) => {
      ctx.beginPath();
      ctx.setLineDash(dash.map((length) => length * devicePixelRatio));
      ctx.moveTo(x(-most), y(-most * slope));
      ctx.lineTo(x(most), y(most * slope));
      ctx.strokeStyle = stroke;
      ctx.lineWidth = width * devicePixelRatio;
      ctx.stroke();
    };
    const { desired, actual, slope } = cloud;
    const size = 2 * devicePixelRatio;
    ctx.fillStyle = colour("desired");
    ctx.globalAlpha = 0.55;
    for (let i = 0; i < actual.length; i++) {
      ctx.fillRect(x(actual[i]) - size / 2, y(desired[i]) - size / 2, size, size);
    }
    ctx.globalAlpha = 1;
    line(1, colour("quiet"), 1, [5, 4]);
    if (Number.isFinite(slope)) line(slope, colour("actual"), 2.2, []);
  });
}

/** Show accelerations in m/s², and the slope of desired on actual if there is one. */
export function showCloud({ desired, actual }, slope) {
  cloud = { desired, actual, slope };
  const sizes = Float32Array.of(...actual, ...desired).map(Math.abs).sort();
  const usual = sizes.length ? sizes[Math.floor(SHARE * sizes.length)] : 0;
  if (limit.meet(ROOM * usual)) cloudPlot.setData(cloudPlot.data);
  else cloudPlot.redraw(false, false);
}
