// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Draws traces quickly: per column of pixels a bar from the least to the greatest value there.
import { GAP } from "./traces.js";

let lows = new Float32Array(0); // device pixels, of the bar of each column
let highs = new Float32Array(0);

/** Widen the bars of the columns that a line from one point to another runs through. */
function markLine(x0, y0, x1, y1) {
  const slope = x1 > x0 ? (y1 - y0) / (x1 - x0) : 0;
  for (let column = Math.max(0, Math.floor(x0)); column <= x1 && column < lows.length; column++) {
    const enter = column > x0 ? y0 + slope * (column - x0) : y0;
    const leave = column + 1 < x1 ? y0 + slope * (column + 1 - x0) : y1;
    lows[column] = Math.min(lows[column], enter, leave);
    highs[column] = Math.max(highs[column], enter, leave);
  }
}

/**
 * Draw a trace. Bars are drawn many times faster than a line of thousands of points, and no peak is
 * lost where there are more samples than columns.
 *
 * @param {CanvasRenderingContext2D} sheet - drawn on in its fill style
 * @param {object} box - left, top, width and height in device pixels
 * @param {object} trace
 * @param {number[]} window - times of the left and the right edge, s since 1970
 * @param {number} limit - value of the upper edge, minus that of the lower edge
 * @param {number} width - of the line, CSS pixels
 */
export function drawTrace(sheet, box, trace, [from, to], limit, width) {
  const columns = Math.ceil(box.width);
  if (lows.length < columns) [lows, highs] = [0, 0].map(() => new Float32Array(columns));
  lows.fill(Infinity, 0, columns);
  highs.fill(-Infinity, 0, columns);
  const perSecond = columns / (to - from);
  let [before, x, y] = [-Infinity, 0, 0];
  for (let i = Math.max(trace.since(from) - 1, trace.oldest); i < trace.count; i++) {
    const time = trace.time(i);
    const [beforeX, beforeY] = [x, y];
    x = (time - from) * perSecond;
    y = box.top + (0.5 - trace.value(i) / (2 * limit)) * box.height;
    if (time - before <= GAP) markLine(beforeX, beforeY, x, y);
    if (x >= columns) break;
    before = time;
  }
  const thick = width * devicePixelRatio;
  for (let column = 0; column < columns; column++) {
    const high = highs[column] - lows[column];
    if (high >= 0) sheet.fillRect(box.left + column, lows[column] - thick / 2, 1, high + thick);
  }
}
