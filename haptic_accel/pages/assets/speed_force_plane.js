// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plot of the contact's force over the speed along the surface, beside the side view.
import { axis, colour } from "./axes.js";
import { byId } from "./elements.js";
import { clear, livePlot, sheetOver } from "./live_plot.js";
import { clamp, here, isKnown } from "./places.js";

const TRAIL = 90; // points that are shown: 1.5 s
const FASTEST = 0.4; // m/s, end of the axis of speed
const HARDEST = 3.5; // N, end of the axis of force: what the arms' motors can give

let plot = null; // made when it is first in the page
let ink = null;
let trail = []; // speed in m/s and force in N, or null without contact
let near = null; // object that the tool is next to

/** Object whose outline is next to a place, and the outline's normal there. */
function nearest([x, z], drawing) {
  let found = null;
  for (const [object, lines] of Object.entries(drawing?.outlines ?? {})) {
    for (const line of lines) {
      for (let i = 1; i < line.length; i++) {
        const [[x0, z0], [x1, z1]] = [line[i - 1], line[i]];
        const [dx, dz] = [x1 - x0, z1 - z0];
        const length = Math.hypot(dx, dz);
        if (!length) continue;
        const part = clamp(((x - x0) * dx + (z - z0) * dz) / length ** 2, [0, 1]);
        const distance = Math.hypot(x - x0 - part * dx, z - z0 - part * dz);
        if (!found || distance < found.distance) {
          found = { object, distance, normal: [-dz / length, dx / length] };
        }
      }
    }
  }
  return found;
}

/** Note speed and force of the contact with what a drawing of the scene shows. */
export function followContact(drawing) {
  const { force, velocity, tool } = here;
  near = isKnown(tool) ? nearest(tool, drawing) : null;
  if (!near || !isKnown(force) || Math.hypot(...force) === 0) trail.push(null);
  else {
    const [nx, nz] = near.normal;
    trail.push([velocity[0] * nz - velocity[1] * nx, force[0] * nx + force[1] * nz].map(Math.abs));
  }
  trail = trail.slice(-TRAIL);
}

/** Forget the contacts so far. */
export function forgetContact() {
  trail = [];
}

/** Make the plot, once its element is in the page. */
export function makePlane() {
  if (plot) return;
  const options = {
    scales: { x: { time: false, range: () => [0, 1e3 * FASTEST] }, y: { range: () => [0, HARDEST] } },
    series: [{}, {}],
    axes: [axis("speed (mm/s)"), axis("force (N)", { size: 34 })],
  };
  plot = livePlot(byId("plane"), options, [[0, 1e3 * FASTEST], [null, null]]);
  ink = sheetOver(byId("plane"));
}

/** Draw the axes again, in other colours. */
export const redrawPlane = () => plot?.redraw();

/** Draw the contacts of the last time, and the nodes of the texture that the tool is next to. */
export function drawPlane(drawing) {
  clear(ink, plot.ctx.canvas);
  const box = plot.bbox;
  const dot = ([speed, force], radius) => {
    const [right, up] = [clamp(speed / FASTEST, [0, 1]), clamp(force / HARDEST, [0, 1])];
    const [x, y] = [box.left + right * box.width, box.top + (1 - up) * box.height];
    ink.beginPath();
    ink.arc(x, y, radius * devicePixelRatio, 0, 2 * Math.PI);
    ink.fill();
  };
  ink.fillStyle = colour("quiet");
  for (const node of drawing.nodes[near?.object] ?? []) dot(node, 1.5);
  ink.fillStyle = colour("force");
  trail.forEach((point, index) => {
    if (!point) return;
    const last = index === trail.length - 1;
    ink.globalAlpha = last ? 1 : 0.35 * (index / trail.length);
    dot(point, last ? 6 : 3);
  });
  ink.globalAlpha = 1;
}
