// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Draws the trial that is chosen, and sorts tables. The data stand in the page as JSON.
(() => {
  "use strict";

  const data = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const HEIGHT = 260; // of a plot, CSS pixels
  const PRINTED = 330; // width of half a printed page, CSS pixels
  const LOWEST = 10; // Hz, of the spectra
  const DECADES = 4.5; // most that an axis of amplitudes spans
  const CURVES = 6; // colours of the page for curves that are compared
  const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [4, 4]];

  let chosen = 0;
  let logarithmic = true;
  let others = false;
  let printing = false;
  let view = "excerpt";
  const charts = new Map();

  // Colours are those of the page, so that light, dark and print need no table of their own.
  const colour = (name) =>
    getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  function unpacked(packed) {
    const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Float64Array.from(
      { length: bytes.length / 2 },
      (_, i) => view.getInt16(2 * i, true) * packed.scale,
    );
  }

  const traces = new Map();
  function trace(trial, part) {
    const key = `${trial.name}/${part}`;
    if (!traces.has(key)) {
      const { begin, step, signals } = trial[part];
      const found = {};
      for (const name of Object.keys(signals)) found[name] = unpacked(signals[name]);
      const length = Math.max(0, ...Object.values(found).map((values) => values.length));
      found.time = Float64Array.from({ length }, (_, i) => begin + i * step);
      traces.set(key, found);
    }
    return traces.get(key);
  }

  function width(id) {
    const wide = byId(id).parentElement.classList.contains("half") ? PRINTED : 2 * PRINTED + 20;
    return printing ? wide : byId(id).clientWidth || wide;
  }

  function axis(label, more = {}) {
    return {
      label,
      labelSize: 20,
      labelGap: 0,
      size: 26,
      font: "12px system-ui, sans-serif",
      labelFont: "12px system-ui, sans-serif",
      stroke: () => colour("quiet"),
      grid: { stroke: () => colour("rule"), width: 1 },
      ticks: { stroke: () => colour("rule"), width: 1, size: 4 },
      ...more,
    };
  }

  const upright = (label, more = {}) => axis(label, { size: 48, ...more });

  // Ticks at 1, 2 and 5 of every decade; evenly spaced ones where too few of these are in sight.
  function onLogarithm() {
    const splits = (_u, _axis, low, high) => {
      const found = [];
      for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power += 1) {
        for (const digit of [1, 2, 5]) {
          const at = digit * 10 ** power;
          if (at >= low && at <= high) found.push(at);
        }
      }
      if (found.length > 1) return found;
      return [1, 2, 3].map((i) => low + ((high - low) * i) / 4);
    };
    const values = (_u, at) => at.map((value) => String(Number(value.toPrecision(2))));
    return { splits, values, filter: (_u, at) => at };
  }

  const shown = (digits, unit) => (_, value) =>
    value == null || !Number.isFinite(value) ? "–" : `${value.toFixed(digits)}${unit}`;

  function line(label, name, digits, unit, more = {}) {
    return {
      label,
      stroke: () => colour(name),
      width: 1.5,
      points: { show: false },
      value: shown(digits, unit),
      ...more,
    };
  }

  function draw(id, options, series) {
    const place = byId(id);
    const hidden = hiddenNames(id);
    charts.get(id)?.destroy();
    charts.delete(id);
    place.replaceChildren();
    if (!series) {
      const words = document.createElement("p");
      words.className = "quiet";
      words.textContent = "Not recorded in this trial.";
      place.append(words);
      return;
    }
    for (const one of options.series) if (hidden.has(one.label)) one.show = false;
    const chart = new uPlot(
      { width: width(id), height: HEIGHT, cursor: { points: { size: 6 } }, ...options },
      series,
      place,
    );
    charts.set(id, chart);
    describe(place, options.name);
    nameToggles(chart);
  }

  function hiddenNames(id) {
    const chart = charts.get(id);
    return new Set(chart ? chart.series.filter((s) => s.show === false).map((s) => s.label) : []);
  }

  function describe(place, words) {
    const canvas = place.querySelector("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", words);
  }

  // The legend's names show and hide curves: from the keyboard as well.
  function nameToggles(chart) {
    chart.root.querySelectorAll(".u-legend .u-series").forEach((row, index) => {
      if (index === 0) return;
      const name = row.querySelector("th");
      name.tabIndex = 0;
      name.setAttribute("role", "button");
      const tell = () => name.setAttribute("aria-pressed", String(chart.series[index].show));
      tell();
      name.addEventListener("click", () => queueMicrotask(tell));
      name.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        name.click();
      });
    });
  }

  // Time

  const VIEWS = [
    ["excerpt", `most active ${data.excerpt} s`],
    ["detail", "around it"],
    ["whole", "whole trial"],
  ];

  function range(trial) {
    const { time } = trace(trial, view === "whole" ? "whole" : "detail");
    if (view === "excerpt") return [trial.begin, trial.begin + data.excerpt];
    return [time[0], time[time.length - 1]];
  }

  function drawTime(trial) {
    const found = trace(trial, view === "whole" ? "whole" : "detail");
    const words = `Acceleration of ${trial.name} over time`;
    const series = [{ label: "time", value: shown(3, " s") }];
    const values = [found.time];
    for (const [name, colourName, wide] of [["desired", "desired", 2], ["actual", "actual", 1.2]]) {
      if (!found[name]) continue;
      const more = { width: wide };
      series.push(line(name, colourName, 2, " m/s²", more));
      values.push(found[name]);
    }
    const [low, high] = range(trial);
    const scales = { x: { time: false, min: low, max: high } };
    draw(
      "time",
      {
        name: words,
        series,
        scales,
        axes: [axis("time (s)"), upright("acceleration (m/s²)")],
        height: HEIGHT + 40,
      },
      values.length > 1 ? values : null,
    );
    draw(
      "error",
      {
        name: `Error of ${trial.name} over time`,
        series: [series[0], line("error", "line", 2, " m/s²")],
        scales,
        axes: [axis("time (s)"), upright("error (m/s²)")],
        height: HEIGHT - 60,
      },
      found.error ? [found.time, found.error] : null,
    );
  }

  function drawOverTime(trial, id, name, label, unit, limit) {
    const found = trace(trial, "whole");
    if (!found[name]) return draw(id, {}, null);
    const series = [{ label: "time", value: shown(2, " s") }, line(name, "curve-1", 3, ` ${unit}`)];
    const values = [found.time, found[name]];
    if (limit) {
      for (const end of [limit, -limit]) {
        series.push(line(end > 0 ? "stop" : "other stop", "line", 1, ` ${unit}`, { dash: [6, 4] }));
        values.push(found.time.map(() => end));
      }
    }
    draw(
      id,
      {
        name: `${label} of ${trial.name} over time`,
        series,
        scales: { x: { time: false } },
        axes: [axis("time (s)"), upright(`${label} (${unit})`)],
        height: HEIGHT - 40,
      },
      values,
    );
  }

  // Regression

  function drawCloud(trial) {
    const cloud = trial.cloud;
    const slope = cloud?.slope ?? null;
    byId("slope").textContent = !cloud
      ? ""
      : slope === null
        ? `R² ${cloud.r2.toFixed(2)}: too little in common for a regression.`
        : `desired = ${slope.toFixed(2)} × actual, R² ${cloud.r2.toFixed(2)}`;
    if (!cloud) return draw("cloud", {}, null);
    const actual = unpacked(cloud.actual);
    const desired = unpacked(cloud.desired);
    const most = (values) => values.reduce((far, value) => Math.max(far, Math.abs(value)), 0);
    const reach = 1.05 * Math.max(most(actual), most(desired), 1e-9);
    // The lines go from end to end, where there need not be a sample.
    const x = [-reach, ...actual, reach];
    const fitted = slope === null ? [] : [x.map((value) => cloud.middle[1] + slope * (value - cloud.middle[0]))];
    draw(
      "cloud",
      {
        name: `Desired against actual acceleration of ${trial.name}, R² ${cloud.r2.toFixed(2)}`,
        series: [
          { label: "actual", value: shown(2, " m/s²") },
          line("desired", "desired", 2, " m/s²", {
            paths: () => null,
            points: { show: true, size: 3, width: 0, fill: () => colour("desired") },
          }),
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

  // Spectra

  function compared(trial) {
    if (!others) return [trial];
    const same = data.trials.filter((t) => t.surface === trial.surface && t.spectra);
    const first = new Map();
    for (const one of [trial, ...same]) {
      if (!first.has(one.controller)) first.set(one.controller, one);
    }
    return [...first.values()];
  }

  function frequencies(trial) {
    const { step, desired } = trial.spectra;
    const first = Math.ceil(LOWEST / step);
    return { first, x: desired.map((_, i) => i * step).slice(first) };
  }

  // A scale that ends where its data do: on its own, a logarithmic one goes on to the next decade.
  function exact(x, distr) {
    const [first, last] = [x[0], x[x.length - 1]];
    const range = (_u, low, high) => [Math.max(low, first), Math.min(high, last)];
    return { time: false, distr, range };
  }

  const frequencyScale = (x) => exact(x, logarithmic ? 3 : 1);

  function frequencyAxis() {
    return axis("frequency (Hz)", logarithmic ? onLogarithm() : {});
  }

  function drawSpectra(trial) {
    if (!trial.spectra) {
      draw("spectra", {}, null);
      draw("coherence", {}, null);
      return;
    }
    const { first, x } = frequencies(trial);
    const part = (values) => values.slice(first).map((v) => (logarithmic && v <= 0 ? null : v));
    const amplitudes = [x, part(trial.spectra.desired)];
    const coherences = [x];
    const names = [
      { label: "frequency", value: shown(0, " Hz") },
      line("desired", "desired", 4, "", { width: 2.5 }),
    ];
    const coherent = [{ label: "frequency", value: shown(0, " Hz") }];
    compared(trial).forEach((one, index) => {
      const label = others ? one.controller : "actual";
      const curve = `curve-${index % CURVES}`;
      const more = { dash: DASHES[index % DASHES.length] };
      names.push(line(label, curve, 4, "", more));
      coherent.push(line(others ? label : "coherence", others ? curve : "curve-2", 2, "", more));
      amplitudes.push(part(one.spectra.actual));
      coherences.push(one.spectra.coherence.slice(first));
    });
    const top = 2 * Math.max(...amplitudes.slice(1).flat().filter(Number.isFinite), 1e-9);
    const positive = amplitudes.slice(1).flat().filter((v) => v > 0);
    const bottom = Math.max(Math.min(...positive, top), top * 10 ** -DECADES);
    const y = logarithmic ? { distr: 3, range: [bottom, top] } : {};
    draw(
      "spectra",
      {
        name: `Amplitude spectra of ${trial.name}`,
        series: names,
        scales: { x: frequencyScale(x), y },
        axes: [frequencyAxis(), upright("m/s²/√Hz", { size: 60 })],
      },
      amplitudes,
    );
    draw(
      "coherence",
      {
        name: `Coherence of ${trial.name}`,
        series: coherent,
        scales: { x: frequencyScale(x), y: { range: [0, 1.02] } },
        axes: [frequencyAxis(), upright("coherence")],
      },
      coherences,
    );
  }

  // Everything

  function drawAll() {
    const trial = data.trials[chosen];
    drawTime(trial);
    drawCloud(trial);
    drawSpectra(trial);
    drawOverTime(trial, "force", "force", "force", "N");
    drawOverTime(trial, "travel", "travel", "travel", "mm", trial.free);
    document.documentElement.dataset.drawn = String(charts.size);
  }

  function choose(index) {
    chosen = (index + data.trials.length) % data.trials.length;
    const trial = data.trials[chosen];
    byId("trial").value = String(chosen);
    const words = `${trial.controller} on ${trial.surface}`;
    byId("shown").textContent = words;
    byId("printed").textContent = `Shown is ${trial.name}, ${words}.`;
    for (const row of document.querySelectorAll("tr[data-trial]")) {
      row.classList.toggle("chosen", Number(row.dataset.trial) === chosen);
    }
    drawAll();
  }

  function fillChooser() {
    const place = byId("trial");
    const parts = new Map();
    data.trials.forEach((trial, index) => {
      const name = `${trial.controller} on ${trial.surface}`;
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
      button.setAttribute("aria-pressed", String(name === view));
      button.addEventListener("click", () => {
        view = name;
        for (const one of byId("views").children) {
          one.setAttribute("aria-pressed", String(one === button));
        }
        drawTime(data.trials[chosen]);
      });
      byId("views").append(button);
    }
  }

  function toggle(id, set) {
    const button = byId(id);
    button.addEventListener("click", () => {
      const pressed = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(pressed));
      set(pressed);
      drawSpectra(data.trials[chosen]);
    });
  }

  // Tables

  function sortBy(table, column, ascending) {
    const body = table.tBodies[0];
    const value = (row) => row.cells[column].dataset.sort ?? row.cells[column].textContent;
    const order = (a, b) => {
      const [x, y] = [value(a), value(b)];
      if (x === "" || y === "") return (x === "") - (y === "");
      const difference = Number(x) - Number(y);
      const compared = Number.isNaN(difference) ? x.localeCompare(y) : difference;
      return ascending ? compared : -compared;
    };
    body.append(...[...body.rows].sort(order));
  }

  function makeSortable(table) {
    const headings = [...table.tHead.rows[0].cells];
    headings.forEach((heading, column) => {
      heading.querySelector("button")?.addEventListener("click", () => {
        const ascending = heading.getAttribute("aria-sort") !== "ascending";
        for (const other of headings) other.removeAttribute("aria-sort");
        heading.setAttribute("aria-sort", ascending ? "ascending" : "descending");
        sortBy(table, column, ascending);
      });
    });
  }

  function print(begins) {
    printing = begins;
    // Paper cannot be opened.
    if (begins) for (const part of document.querySelectorAll("details")) part.open = true;
    drawAll();
  }

  document.querySelectorAll("table.sorting").forEach(makeSortable);
  fillChooser();
  fillViews();
  toggle("logarithmic", (on) => { logarithmic = on; });
  toggle("others", (on) => { others = on; });
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
})();
