// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The side view of what the tool touches. A drawing is what the scope serves as /scene: a view box,
// outlines by object, and the offset from the handle's frame to the tool's, all in m.
import { colour } from "./axes.js";
import { byId } from "./elements.js";
import { clear, sheetOver } from "./live_plot.js";
import { here, isKnown } from "./places.js";

const ARROW = 0.008; // m that stand for 1 N of contact force

/** Element that holds the view. */
export const view = byId("scene");
const sheet = sheetOver(view);

/** Return pixels per metre, and functions from metres to device pixels of the canvas. */
function mapping(drawing) {
  const [[left, right], [low, high]] = drawing.view;
  const { width, height } = sheet.canvas;
  const scale = Math.min(width / (right - left), height / (high - low));
  const x = (value) => width / 2 + (value - (left + right) / 2) * scale;
  const z = (value) => height / 2 - (value - (low + high) / 2) * scale;
  return { scale, x, z };
}

/** Return the point of a drawing at a place in the window, in m. */
export function pointAt(drawing, { clientX, clientY }) {
  const { left, top } = sheet.canvas.getBoundingClientRect();
  const { scale, x, z } = mapping(drawing);
  return [((clientX - left) * devicePixelRatio - x(0)) / scale, (z(0) - (clientY - top) * devicePixelRatio) / scale];
}

/** Draw the objects, and tool and handle if they are known. */
export function drawSideView(drawing) {
  const ratio = devicePixelRatio;
  const [width, height] = [view.clientWidth, view.clientHeight].map((size) => Math.round(size * ratio));
  clear(sheet, { width, height });
  const map = mapping(drawing);
  drawObjects(drawing, map, ratio);
  if (isKnown(here.tool)) drawTool(map, ratio);
  if (isKnown(here.handle)) drawHandle(drawing, map, ratio);
  if (isKnown(here.tool)) drawForce(map, ratio);
}

function drawObjects(drawing, { x, z }, ratio) {
  const { height } = sheet.canvas;
  sheet.lineWidth = 1.5 * ratio;
  sheet.font = `${12 * ratio}px system-ui, sans-serif`;
  for (const [object, lines] of Object.entries(drawing.outlines)) {
    for (const line of lines) {
      const points = line.map(([px, pz]) => [x(px), z(pz)]);
      const outline = new Path2D();
      points.forEach((point, index) => outline[index ? "lineTo" : "moveTo"](...point));
      const solid = new Path2D(outline);
      if (Math.hypot(points[0][0] - points.at(-1)[0], points[0][1] - points.at(-1)[1]) > 1) {
        // What leaves the view at both sides is solid below.
        solid.lineTo(points.at(-1)[0], height);
        solid.lineTo(points[0][0], height);
      }
      sheet.fillStyle = colour("still-fill");
      sheet.fill(solid);
      sheet.strokeStyle = colour("quiet");
      sheet.stroke(outline);
    }
    if (!lines.length) continue;
    const corners = lines.flat();
    const centre = [0, 1].map((axis) => {
      const values = corners.map((corner) => corner[axis]);
      return (Math.min(...values) + Math.max(...values)) / 2;
    });
    const flat = lines.every((line) => line.every(([, pz]) => Math.abs(pz - line[0][1]) < 1e-6));
    sheet.fillStyle = colour("quiet");
    sheet.textAlign = flat ? "left" : "center";
    sheet.fillText(object, flat ? 10 * ratio : x(centre[0]), z(centre[1]) + (flat ? 18 : 4) * ratio);
  }
}

/** A stylus on its tip. */
function drawTool({ x, z }, ratio) {
  const [tx, tz] = [x(here.tool[0]), z(here.tool[1])];
  const width = 5 * ratio;
  sheet.beginPath();
  for (const [right, up] of [[0, 0], [-1, 3], [-1, 16], [1, 16], [1, 3]]) {
    sheet.lineTo(tx + right * width, tz - up * width);
  }
  sheet.closePath();
  sheet.fillStyle = colour("desired");
  sheet.fill();
}

function drawHandle(drawing, { x, z }, ratio) {
  const place = here.handle.map((value, axis) => value + drawing.offset[axis]);
  sheet.beginPath();
  sheet.arc(x(place[0]), z(place[1]), 9 * ratio, 0, 2 * Math.PI);
  sheet.lineWidth = 2.5 * ratio;
  sheet.strokeStyle = colour("actual");
  sheet.stroke();
}

/** An arrow that ends at the tip, clear of the stylus. */
function drawForce({ scale, x, z }, ratio) {
  const [fx, fz] = here.force.map((value) => value * ARROW * scale);
  const length = Math.hypot(fx, fz);
  if (!(length > 1)) return;
  const head = Math.min(length, 7 * ratio);
  sheet.save();
  sheet.translate(x(here.tool[0]) - fx, z(here.tool[1]) + fz);
  sheet.rotate(Math.atan2(-fz, fx));
  sheet.fillStyle = colour("force");
  sheet.fillRect(0, -1.5 * ratio, length - head / 2, 3 * ratio);
  sheet.beginPath();
  sheet.moveTo(length, 0);
  sheet.lineTo(length - head, -head * 0.7);
  sheet.lineTo(length - head, head * 0.7);
  sheet.fill();
  sheet.restore();
}
