// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// A plot of the page, drawn again for each trial; its legend shows and hides curves.
import { axis, colour } from "./axes.js";
import { byId, digits, press } from "./elements.js";

/** Height of a plot, CSS pixels. */
export const HEIGHT = 260;
const PRINTED = 330; // width of half a printed page, CSS pixels

/** The plots that are drawn, by the id of their element. */
export const charts = new Map();

/** Whether the page is being printed. */
export const paper = { printing: false };

function width(place) {
  const wide = place.parentElement.classList.contains("half") ? PRINTED : 2 * PRINTED + 20;
  return paper.printing ? wide : place.clientWidth || wide;
}

/** Return a vertical axis; options that differ are those of `axis`. */
export const upright = (label, more) => axis(label, { size: 50, ...more });

/** Return a curve: its name, its colour's name, digits after the point, unit, and uPlot's options. */
export const line = (label, name, places, unit, more) => ({
  ...legend(label, places, unit),
  stroke: () => colour(name),
  width: 1.5,
  points: { show: false },
  ...more,
});

/** Return how the legend names a quantity: digits after the point, and the unit. */
export const legend = (label, places, unit) => ({
  label,
  value: (_, value) => (Number.isFinite(value) ? digits(value, places) + unit : "–"),
});

/** Draw a plot into the element of an id; without data, say so. */
export function draw(id, options, series) {
  const place = byId(id);
  const hidden = (charts.get(id)?.series ?? []).filter((one) => one.show === false);
  charts.get(id)?.destroy();
  charts.delete(id);
  place.replaceChildren();
  if (!series) {
    place.innerHTML = '<p class="quiet">Not recorded in this trial.</p>';
    return;
  }
  for (const { label } of hidden) {
    for (const one of options.series) if (one.label === label) one.show = false;
  }
  const size = { width: width(place), height: HEIGHT };
  const chart = new uPlot({ ...size, cursor: { points: { size: 6 } }, ...options }, series, place);
  charts.set(id, chart);
  const canvas = place.querySelector("canvas");
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", options.name);
  nameToggles(chart);
}

// The legend's names show and hide curves: from the keyboard as well.
function nameToggles(chart) {
  const rows = [...chart.root.querySelectorAll(".u-legend .u-series")];
  rows.forEach((row, i) => {
    const index = i + chart.series.length - rows.length; // without values there is no row of x
    if (index === 0) return;
    const name = row.querySelector("th");
    name.tabIndex = 0;
    name.setAttribute("role", "button");
    const tell = () => press(name, chart.series[index].show);
    tell();
    name.addEventListener("click", () => queueMicrotask(tell));
    name.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      name.click();
    });
  });
}
