// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plots of a trial's signals: over time, and desired against actual acceleration.
import { HEIGHT, draw, legend, line, upright } from "./analysis_chart.js";
import { data, everything, trace, unpacked } from "./analysis_data.js";
import { axis, colour } from "./axes.js";
import { byId } from "./elements.js";

/** Draw those of the curves that have values over times in s; `x` holds options of that axis. */
function overTime(id, name, time, label, curves, { height, places, x }) {
  const found = curves.filter(([values]) => values);
  const options = {
    name: `${name} over time`,
    series: [legend("time", places, " s"), ...found.map(([, curve]) => curve)],
    scales: { x: { time: false, ...x } },
    axes: [axis("time (s)"), upright(label)],
    height,
  };
  draw(id, options, found.length ? [time, ...found.map(([values]) => values)] : null);
}

/** Draw accelerations and error of a trial: the view "whole", "detail", or "excerpt" of it. */
export function drawTime(trial, view) {
  const { time, desired, actual, error } = trace(trial, view === "whole" ? "whole" : "detail");
  const [min, max] =
    view === "excerpt" ? [trial.begin, trial.begin + data.excerpt] : [time[0], time[time.length - 1]];
  const form = { places: 3, x: { min, max } };
  const curves = [
    [desired, line("desired", "desired", 2, " m/s²", { width: 2 })],
    [actual, line("actual", "actual", 2, " m/s²", { width: 1.2 })],
  ];
  const errors = [[error, line("error", "line", 2, " m/s²")]];
  const [high, low] = [40, -60].map((more) => ({ ...form, height: HEIGHT + more }));
  overTime("time", `Acceleration of ${trial.name}`, time, "acceleration (m/s²)", curves, high);
  overTime("error", `Error of ${trial.name}`, time, "error (m/s²)", errors, low);
}

/** Draw a signal of the whole trial in its unit, and where it ends on both sides if that is known. */
export function drawWhole(trial, name, unit, limit) {
  const found = trace(trial, "whole");
  const curves = [[found[name], line(name, "curve-1", 3, ` ${unit}`)]];
  if (limit && found[name]) {
    for (const end of [limit, -limit]) {
      const stop = line(end > 0 ? "stop" : "other stop", "line", 1, ` ${unit}`, { dash: [6, 4] });
      curves.push([found.time.map(() => end), stop]);
    }
  }
  const form = { places: 2, height: HEIGHT - 40 };
  overTime(name, `${name} of ${trial.name}`, found.time, `${name} (${unit})`, curves, form);
}

/** Draw the desired against the actual acceleration of a trial, and the regression's line. */
export function drawCloud(trial) {
  const cloud = trial.cloud;
  const slope = cloud?.slope ?? null;
  const r2 = `R² ${cloud?.r2.toFixed(2)}`;
  const words =
    slope === null
      ? `${r2}: too little in common for a regression.`
      : `desired = ${slope.toFixed(2)} × actual, ${r2}`;
  byId("slope").textContent = cloud ? words : "";
  if (!cloud) return draw("cloud", {}, null);
  const actual = unpacked(cloud.actual);
  const desired = unpacked(cloud.desired);
  const most = (values) => values.reduce((far, value) => Math.max(far, Math.abs(value)), 0);
  const reach = 1.05 * Math.max(most(actual), most(desired), 1e-9);
  // The lines go from end to end, where there need not be a sample.
  const x = [-reach, ...actual, reach];
  const fit = (value) => cloud.middle[1] + slope * (value - cloud.middle[0]);
  const fitted = slope === null ? [] : [x.map(fit)];
  const points = { show: true, size: 3, width: 0, fill: () => colour("desired") };
  draw(
    "cloud",
    {
      name: `Desired against actual acceleration of ${trial.name}, ${r2}`,
      series: [
        legend("actual", 2, " m/s²"),
        line("desired", "desired", 2, " m/s²", { paths: () => null, points }),
        ...fitted.map(() => line("regression", "line", 2, " m/s²", { width: 2 })),
        line("1:1", "text", 2, " m/s²", { dash: [6, 4], width: 1 }),
      ],
      scales: { x: { time: false, range: [-reach, reach] }, y: { range: [-reach, reach] } },
      axes: [axis("actual (m/s²)"), upright("desired (m/s²)")],
      height: HEIGHT + 40,
    },
    [x, [null, ...desired, null], ...fitted, x],
  );
}

const SIDE = 260; // of a plane, CSS pixels
const EDGES = { left: 68, bottom: 46, top: 10, right: 12 }; // axes and padding, CSS pixels

/** Draw the paths of desired and actual acceleration in the planes of each two axes. */
export function drawPlanes(trial) {
  const found = everything(trial, "detail");
  const within = (_, i) => found.time[i] >= trial.begin && found.time[i] < trial.begin + data.path;
  const part = (name, axis) => found[`${name}_${axis}`]?.filter(within);
  const names = Object.keys(trial.axes ?? {});
  const planes = names.flatMap((across, i) => names.slice(i + 1).map((up) => [across, up]));
  const values = names.flatMap((axis) => ["desired", "actual"].map((name) => part(name, axis)));
  const known = values.length && values.every(Boolean);
  const reach = known && 1.05 * Math.max(...values.map((v) => Math.max(...v.map(Math.abs))), 1e-9);
  byId("polarisation").hidden = !names.length;
  planes.forEach(([across, up], i) => {
    const id = `plane-${i}`;
    if (!known) return draw(id, {}, null);
    const curves = ["desired", "actual"].map((name, k) => {
      const xs = part(name, across);
      const ys = part(name, up);
      const style = { paths: (u) => path(u, xs, ys), width: k ? 1.2 : 2 };
      return line(name, name, 2, " m/s²", style);
    });
    const range = [-reach, reach];
    const options = {
      name: `Desired and actual acceleration of ${trial.name} in the plane of ${across} and ${up}`,
      series: [legend(across, 2, " m/s²"), ...curves],
      scales: { x: { time: false, range }, y: { range } },
      axes: [axis(`${across} (m/s²)`), upright(`${up} (m/s²)`)],
      width: SIDE + EDGES.left + EDGES.right,
      height: SIDE + EDGES.bottom + EDGES.top,
      padding: [EDGES.top, EDGES.right, 0, 0],
      legend: { live: false },
      cursor: { show: false },
    };
    // The curves are paths, which a plot of values over x cannot have: these only fill its range.
    draw(id, options, [range, [null, null], [null, null]]);
  });
}

/** Return the path through points given in the units of a plot. */
function path(u, xs, ys) {
  const stroke = new Path2D();
  xs.forEach((x, i) => stroke.lineTo(u.valToPos(x, "x", true), u.valToPos(ys[i], "y", true)));
  return { stroke };
}
