// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Colours and axes of plots. Colours are those of the style sheet, so that light, dark and print
// need no table here.

const FONT = "12px system-ui, sans-serif";
const colours = new Map();

/** Return the colour that the style sheet has under a name. */
export function colour(name) {
  if (!colours.has(name)) {
    const style = getComputedStyle(document.documentElement);
    colours.set(name, style.getPropertyValue(`--${name}`).trim());
  }
  return colours.get(name);
}

/** Read the colours again when they are needed next: the page has become dark, light or printed. */
export const forgetColours = () => colours.clear();

/**
 * Return an axis for uPlot.
 *
 * @param {string} label - quantity and unit
 * @param {object} [more] - options that differ: `size` of the numbers beside the axis, CSS pixels
 */
export const axis = (label, more) => ({
  label,
  size: 28,
  labelSize: 18,
  labelGap: 0,
  labelFont: FONT,
  font: FONT,
  stroke: () => colour("quiet"),
  grid: { stroke: () => colour("grid"), width: 1 },
  ticks: { stroke: () => colour("grid"), width: 1, size: 4 },
  ...more,
});
