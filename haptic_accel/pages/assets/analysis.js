// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The page of an analysis: draws the trial that is chosen, in the view that is chosen.
import { charts, paper } from "./analysis_chart.js";
import { data, shown, viewed } from "./analysis_data.js";
import { drawSpectra } from "./analysis_spectra.js";
import { drawCloud, drawPlanes, drawTime, drawWhole } from "./analysis_signals.js";
import { forgetColours } from "./axes.js";
import { byId, isPressed, press } from "./elements.js";
import { makeSortable } from "./sortable_tables.js";

const VIEWS = [
  ["excerpt", `most active ${data.excerpt} s`],
  ["detail", "around it"],
  ["whole", "whole trial"],
];

const look = { view: "excerpt", logarithmic: true, others: false };
let chosen = 0;

function drawAll() {
  forgetColours();
  const trial = viewed(data.trials[chosen]);
  drawTime(trial, look.view);
  drawCloud(trial);
  drawSpectra(trial, look);
  drawWhole(trial, "force", "N");
  drawWhole(trial, "travel", "mm", trial.free);
  if (byId("polarisation")) drawPlanes(trial);
  document.documentElement.dataset.drawn = String(charts.size);
}

const titleOf = ({ controller, surface }) => `${controller} on ${surface}`;

function choose(index) {
  chosen = (index + data.trials.length) % data.trials.length;
  const trial = data.trials[chosen];
  byId("trial").value = String(chosen);
  byId("shown").textContent = titleOf(trial);
  byId("printed").textContent = `Shown is ${trial.name}, ${titleOf(trial)}.`;
  for (const row of document.querySelectorAll("tr[data-trial]")) {
    row.classList.toggle("chosen", Number(row.dataset.trial) === chosen);
  }
  drawAll();
}

function fillChooser() {
  const place = byId("trial");
  const parts = new Map();
  data.trials.forEach((trial, index) => {
    const name = titleOf(trial);
    if (!parts.has(name)) {
      const part = document.createElement("optgroup");
      part.label = name;
      parts.set(name, part);
      place.append(part);
    }
    parts.get(name).append(new Option(trial.name, String(index)));
  });
  place.addEventListener("change", () => choose(Number(place.value)));
  byId("before").addEventListener("click", () => choose(chosen - 1));
  byId("after").addEventListener("click", () => choose(chosen + 1));
  for (const row of document.querySelectorAll("tr[data-trial] a")) {
    row.addEventListener("click", () => choose(Number(row.closest("tr").dataset.trial)));
  }
}

function fillViews() {
  for (const [name, words] of VIEWS) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = words;
    press(button, name === look.view);
    button.addEventListener("click", () => {
      look.view = name;
      for (const one of byId("views").children) press(one, one === button);
      drawTime(viewed(data.trials[chosen]), name);
    });
    byId("views").append(button);
  }
}

function fillAxes() {
  for (const button of document.querySelectorAll("button[data-axis]")) {
    press(button, button.dataset.axis === shown.axis);
    button.addEventListener("click", () => {
      shown.axis = button.dataset.axis;
      for (const one of document.querySelectorAll("button[data-axis]")) press(one, one === button);
      drawAll();
    });
  }
}

function print(begins) {
  paper.printing = begins;
  // Paper cannot be opened.
  if (begins) for (const part of document.querySelectorAll("details")) part.open = true;
  drawAll();
}

document.querySelectorAll("table.sorting").forEach(makeSortable);
fillChooser();
fillViews();
fillAxes();
for (const name of ["logarithmic", "others"]) {
  const button = byId(name);
  button.addEventListener("click", () => {
    look[name] = !isPressed(button);
    press(button, look[name]);
    drawSpectra(viewed(data.trials[chosen]), look);
  });
}
choose(data.first);

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
matchMedia("print").addEventListener("change", (event) => print(event.matches));
addEventListener("beforeprint", () => print(true));
addEventListener("afterprint", () => print(false));
let waiting = 0;
addEventListener("resize", () => {
  cancelAnimationFrame(waiting);
  waiting = requestAnimationFrame(drawAll);
});
