// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plots of live data: their size and scales follow, and canvases over them are drawn often.

export const SHRINK = 1.5; // s for which a smaller range would do before a scale is reduced

/** Make a plot that fills an element, whose size it follows; options and data are uPlot's. */
export function livePlot(holder, options, data) {
  const size = () => ({ width: holder.clientWidth, height: holder.clientHeight });
  const plain = { legend: { show: false }, cursor: { show: false } };
  const made = new uPlot({ ...plain, ...size(), ...options }, data, holder);
  new ResizeObserver(() => made.setSize(size())).observe(holder);
  return made;
}

/** Lay a canvas over an element, and return what draws on it. */
export function sheetOver(holder) {
  return holder.appendChild(document.createElement("canvas")).getContext("2d");
}

/** Clear a canvas, and give it a size in device pixels; each change of a size costs a new canvas. */
export function clear(sheet, { width, height }) {
  if (sheet.canvas.width !== width) sheet.canvas.width = width;
  if (sheet.canvas.height !== height) sheet.canvas.height = height;
  sheet.clearRect(0, 0, width, height);
}

/** Draw within a box in device pixels. */
export function clipped(sheet, box, draw) {
  sheet.save();
  sheet.beginPath();
  sheet.rect(box.left, box.top, box.width, box.height);
  sheet.clip();
  draw();
  sheet.restore();
}

/** Smallest round number that is not below the value. */
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((step) => step * power).find((step) => step >= value * 0.999);
}

/** Limit of a scale, in the unit of what it shows: it grows at once and shrinks only after a while. */
export class Limit {
  constructor(least) {
    this.least = least;
    this.value = least;
    this.since = 0;
  }

  /** Adapt to the largest magnitude shown, to a smaller one after a time in s; return true on a change. */
  meet(magnitude, patience = SHRINK) {
    const wanted = Math.max(this.least, roundUp(1.05 * Math.max(magnitude, 1e-9)));
    const now = performance.now() / 1000;
    if (wanted >= this.value) this.since = now;
    const changes = wanted > this.value || (wanted < this.value && now - this.since > patience);
    if (changes) [this.value, this.since] = [wanted, now];
    return changes;
  }
}
