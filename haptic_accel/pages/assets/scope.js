// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The live scope's page: receives frames of samples, draws them, and sends commands.
// The frames are described in haptic_accel/scope/frames.py. Units are SI until they are shown.
"use strict";

(() => {
  const SAMPLES = 1;
  const PLOTS = 2;
  const PLACED = 3;
  const TRACES = ["desired", "actual", "force", "travel", "arm_force", "position"];
  const ON_DEMAND = ["arm_force", "position"]; // traces that are sent only if they are asked for
  const REMEMBERED = "haptic_accel scope: signals"; // name under which the browser keeps the choice
  const CAPACITY = 1 << 17; // samples of a trace; at 20 kHz more than the longest window
  const LAG = 0.05; // s behind the newest sample, so that the right edge does not flicker
  const GAP = 0.02; // s without a sample across which no line is drawn
  const JUMP = 0.25; // s by which the clocks may drift apart before they are synchronised again
  const SHRINK = 1.5; // s for which a smaller range would do before a scale is reduced
  const BAND = 1.0; // s whose range the pale band of a gauge shows
  const QUIET = 1.0; // s without samples after which a gauge shows nothing
  const OLD = 0.3; // s, age of the newest sample from which on it is a warning
  const DRIFT = 1e-4; // s/s by which the steady clocks of two machines may drift apart
  const LOST = 500; // ms without a state from the scope after which what is shown counts as unknown
  const WATCH = 100; // ms between two looks for that
  const RENEW = 5000; // ms without one after which another connection is tried
  const INTERNAL_ERROR = 1011; // WebSocket's code: the server failed
  const PROMPT = 20; // ms to the next picture of a machine that draws all of them
  const LEFT = 4; // of the time that plots cost beyond that, part that they leave to others
  const CALM = 250; // ms between two frames if the user prefers reduced motion
  const HEARD = 45; // ms between two frames where they hold up the sound
  const DESCRIBE = 5000; // ms between two descriptions of a plot for screen readers
  const SAID = 10000; // ms for which a message stays visible
  const FIRST_RETRY = 250; // ms
  const LAST_RETRY = 2000; // ms
  const COMMAND_TIME = 4000; // ms after which a command has failed
  const LOWEST = 10; // Hz, where spectra begin
  const CLOUD_SHARE = 0.97; // of the values that the cloud's scale is chosen for
  const CLOUD_ROOM = 1.5; // margin of the scale beyond these values
  const LEAST_TOP = 0.1; // m/s²/√Hz, lowest upper end of that axis; the sensors' noise is at its lower end
  const DECADES = 3; // of the spectra's vertical axis

  const byId = (id) => document.getElementById(id);
  const control = document.body.dataset.control === "true";
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  const dark = matchMedia("(prefers-color-scheme: dark)");

  function setText(element, text) {
    if (element && element.textContent !== text) element.textContent = text;
  }

  function setState(element, state, text) {
    if (element.dataset.state !== state) element.dataset.state = state;
    setText(element, text);
  }

  // ---- Traces -----------------------------------------------------------------------------

  class Trace {
    constructor() {
      this.times = new Float64Array(CAPACITY);
      this.values = new Float32Array(CAPACITY);
      this.count = 0;
    }

    push(origin, offsets, values) {
      for (let i = 0; i < offsets.length; i++) {
        const place = this.count++ % CAPACITY;
        this.times[place] = origin + offsets[i];
        this.values[place] = values[i];
      }
    }

    copy() {
      const { times, values, count } = this;
      return Object.assign(new Trace(), { times: times.slice(), values: values.slice(), count });
    }

    get newest() {
      return this.count ? this.times[(this.count - 1) % CAPACITY] : -Infinity;
    }

    get last() {
      return this.count ? this.values[(this.count - 1) % CAPACITY] : NaN;
    }

    /** Number of the first sample that is not before a time. */
    since(time) {
      const oldest = Math.max(0, this.count - CAPACITY);
      let low = oldest;
      let high = this.count;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (this.times[middle % CAPACITY] < time) low = middle + 1;
        else high = middle;
      }
      return low;
    }

    /** Value of the sample nearest to a time; NaN if there is none near it. */
    near(time) {
      const after = this.since(time);
      const [before, next] = [after - 1, after].map((i) => Math.abs(this.times[i % CAPACITY] - time));
      if (!(Math.min(before, next) < GAP)) return NaN;
      return this.values[(after - (before < next)) % CAPACITY];
    }

    /** Least and greatest value from one time to another. */
    extremes(time, end = Infinity) {
      let least = Infinity;
      let greatest = -Infinity;
      for (let i = this.since(time); i < this.count; i++) {
        if (this.times[i % CAPACITY] > end) break;
        const value = this.values[i % CAPACITY];
        if (value < least) least = value;
        if (value > greatest) greatest = value;
      }
      return least <= greatest ? [least, greatest] : [0, 0];
    }
  }

  const traces = Object.fromEntries(TRACES.map((name) => [name, new Trace()]));
  const counters = { drawn: 0, frames: 0, bytes: 0, states: 0 };
  let state = null;
  let plots = null;

  // The server's clock and this page's differ: the newest stamps show by how much.
  const clock = {
    offset: null,
    meet(newest) {
      const found = newest - performance.now() / 1000;
      if (this.offset === null || Math.abs(found - this.offset) > JUMP) this.offset = found;
      else this.offset += 0.05 * (found - this.offset);
    },
    get now() {
      return this.offset === null ? 0 : performance.now() / 1000 + this.offset;
    },
  };

  /** Age of the newest sample: as the scope sent it, with the time it took from there until now. */
  const age = {
    found: null, // s, on arrival of the newest frame; null before the first
    at: 0, // s, time of that arrival
    least: Infinity, // s, difference of the two clocks with the shortest transit
    forget() {
      Object.assign(this, { found: null, at: 0, least: Infinity });
    },
    meet(sent, when) {
      const now = performance.now() / 1000;
      const transit = now - when;
      this.least = Math.min(this.least + DRIFT * (now - this.at), transit);
      this.found = sent + transit - this.least;
      this.at = now;
    },
    get now() {
      return this.found === null ? null : this.found + performance.now() / 1000 - this.at;
    },
  };

  // ---- Scales -----------------------------------------------------------------------------

  /** Smallest round number that is not below the value. */
  function roundUp(value) {
    const power = 10 ** Math.floor(Math.log10(value));
    return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((step) => step * power).find((step) => step >= value * 0.999);
  }

  /** Limit of a scale that grows at once and shrinks only after a while. */
  class Limit {
    constructor(least) {
      this.least = least;
      this.value = least;
      this.since = 0;
    }

    /** Adapt to the largest magnitude shown, to a smaller one after a while; return true if the limit changed. */
    meet(magnitude, patience = SHRINK) {
      const wanted = Math.max(this.least, roundUp(1.05 * Math.max(magnitude, 1e-9)));
      const now = performance.now() / 1000;
      if (wanted >= this.value) this.since = now;
      if (wanted > this.value || (wanted < this.value && now - this.since > patience)) {
        this.value = wanted;
        this.since = now;
        return true;
      }
      return false;
    }
  }

  // ---- Plots ------------------------------------------------------------------------------

  function colours() {
    const style = getComputedStyle(document.documentElement);
    const names = [...TRACES, "quiet", "grid", "still-fill"];
    return Object.fromEntries(names.map((n) => [n, style.getPropertyValue(`--${n}`).trim()]));
  }

  let colour = colours();

  function axis(label, more) {
    return {
      label,
      size: 28,
      labelSize: 18,
      labelGap: 0,
      labelFont: "12px system-ui, sans-serif",
      font: "12px system-ui, sans-serif",
      stroke: () => colour.quiet,
      grid: { stroke: () => colour.grid, width: 1 },
      ticks: { stroke: () => colour.grid, width: 1, size: 4 },
      ...more,
    };
  }

  function plot(id, options, data) {
    const holder = byId(id);
    const size = () => ({ width: holder.clientWidth, height: holder.clientHeight });
    const made = new uPlot(
      { legend: { show: false }, cursor: { show: false }, ...size(), ...options },
      data,
      holder,
    );
    new ResizeObserver(() => made.setSize(size())).observe(holder);
    return made;
  }

  function clipped(ctx, bbox, draw) {
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    draw();
    ctx.restore();
  }

  let lows = new Float32Array(0);
  let highs = new Float32Array(0);

  /**
   * Draw a trace from one time to another: per column of pixels a bar from the least to the
   * greatest value of the line there. Bars are drawn many times faster than a line of
   * thousands of points, and no peak is lost where there are more samples than columns.
   */
  function drawTrace(ctx, box, trace, from, to, limit, stroke, width) {
    const columns = Math.ceil(box.width);
    if (lows.length < columns) [lows, highs] = [0, 0].map(() => new Float32Array(columns));
    lows.fill(Infinity, 0, columns);
    highs.fill(-Infinity, 0, columns);
    const perSecond = columns / (to - from);
    const first = Math.max(trace.since(from) - 1, 0, trace.count - CAPACITY);
    let [before, x, y] = [-Infinity, 0, 0];
    for (let i = first; i < trace.count; i++) {
      const time = trace.times[i % CAPACITY];
      const [beforeX, beforeY] = [x, y];
      x = (time - from) * perSecond;
      y = box.top + (0.5 - trace.values[i % CAPACITY] / (2 * limit)) * box.height;
      if (time - before <= GAP) markLine(beforeX, beforeY, x, y);
      if (x >= columns) break;
      before = time;
    }
    const thick = width * devicePixelRatio;
    ctx.fillStyle = stroke;
    for (let column = 0; column < columns; column++) {
      const high = highs[column] - lows[column];
      if (high >= 0) ctx.fillRect(box.left + column, lows[column] - thick / 2, 1, high + thick);
    }
  }

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

  let windowLength = Number(byId("window").value);
  let held = null; // time at the right edge, and the traces as they were, while the plots are held

  /** Plot of traces of one unit over time. */
  class Strip {
    constructor(id, unit, factor, places, least, names) {
      Object.assign(this, { holder: byId(id), unit, factor, places, names, limit: new Limit(least) });
      this.plot = plot(
        id,
        {
          scales: {
            x: { time: false },
            y: { range: () => [-1, 1].map((sign) => sign * factor * this.limit.value) },
          },
          series: [{}, {}],
          axes: [axis("time before now (s)"), axis(unit, { size: 52 })],
          cursor: { y: false, points: { show: false }, sync: { key: "time" } },
          hooks: { draw: [() => held && this.draw()], setCursor: [readCursor] },
        },
        this.wholeWindow(),
      );
      // The traces have a canvas of their own: the axes behind it are redrawn rarely.
      this.sheet = document.createElement("canvas").getContext("2d");
      this.holder.append(this.sheet.canvas);
    }

    get shown() {
      return this.names.filter((name) => chosen.has(name));
    }

    /** Data whose range is the window; the traces themselves are drawn over the plot. */
    wholeWindow() {
      return [[-windowLength, 0], [null, null]];
    }

    reset() {
      this.plot.setData(this.wholeWindow());
    }

    draw() {
      const { plot, sheet, limit, shown } = this;
      if (!shown.length) return;
      const source = held?.traces ?? traces;
      const right = held?.time ?? clock.now - LAG;
      const [from, to] = [plot.scales.x.min, plot.scales.x.max].map((time) => right + time);
      const extremes = shown.flatMap((name) => source[name].extremes(from, to));
      if (limit.meet(Math.max(...extremes.map(Math.abs)), held ? 0 : SHRINK)) {
        queueMicrotask(() => plot.redraw()); // in the hook that calls this, it would be ignored
      }
      const { width, height } = plot.ctx.canvas;
      if (sheet.canvas.width !== width) sheet.canvas.width = width;
      if (sheet.canvas.height !== height) sheet.canvas.height = height;
      sheet.clearRect(0, 0, width, height);
      clipped(sheet, plot.bbox, () => {
        for (const name of shown) {
          // The first is behind, and shows through the second.
          const first = name === this.names[0];
          sheet.globalAlpha = first ? 1 : 0.85;
          drawTrace(sheet, plot.bbox, source[name], from, to, limit.value, colour[name], first ? 2 : 1.2);
        }
      });
    }

    /** Move the cursor by CSS pixels; from the middle if there is none. */
    moveCursor(step) {
      if (!this.shown.length) return;
      const { cursor, over } = this.plot;
      const left = cursor.left < 0 ? over.clientWidth / 2 : cursor.left + step;
      this.plot.setCursor({ left: Math.min(Math.max(left, 0), over.clientWidth - 1), top: 0 });
    }

    /** Values at a time before the right edge, with their names and unit. */
    read(before) {
      return this.shown.map((name) => {
        const value = held.traces[name].near(held.time + before) * this.factor;
        const words = byId(`show-${name}`).closest("label").textContent.trim();
        return `${words} ${Number.isNaN(value) ? "–" : value.toFixed(this.places)} ${this.unit}`;
      });
    }
  }

  const chosen = new Set(remembered() ?? ["desired", "actual"]);
  const strips = [
    new Strip("time", "m/s²", 1, 2, 1, ["desired", "actual"]),
    new Strip("forces", "N", 1, 3, 0.1, ["force", "arm_force"]),
    new Strip("positions", "mm", 1e3, 3, 1e-4, ["travel", "position"]),
  ];

  function readCursor(u) {
    if (!held) return;
    const at = u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : null;
    const values = at === null ? [] : strips.flatMap((strip) => strip.read(at));
    const hint = "To read the curves, point at them, or press the left and right arrow keys. "
      + "Drag to zoom; double-click for the whole window.";
    setText(byId("reading"), at === null ? hint : `${at.toFixed(4)} s: ${values.join(", ")}`);
  }

  function setHold(hold) {
    held = hold ? { time: clock.now - LAG, traces: Object.fromEntries(TRACES.map((name) => [name, traces[name].copy()])) } : null;
    byId("hold").setAttribute("aria-pressed", String(hold));
    byId("reading").hidden = !hold;
    for (const { holder, plot } of strips) {
      holder.classList.toggle("held", hold);
      plot.setCursor({ left: -10, top: -10 });
    }
    for (const strip of strips) strip.reset();
  }

  /** Names of the signals that were shown last; null if the browser keeps nothing. */
  function remembered() {
    try {
      return localStorage.getItem(REMEMBERED)?.split(" ");
    } catch {
      return null;
    }
  }

  function choose(name, wanted) {
    if (wanted) chosen.add(name);
    else chosen.delete(name);
    showSignals();
    askForSignals();
    try {
      localStorage.setItem(REMEMBERED, [...chosen].join(" "));
    } catch {
      // the choice lasts as long as the page
    }
  }

  function showSignals() {
    for (const { holder, shown, plot } of strips) {
      holder.hidden = !shown.length;
      if (held) plot.redraw();
    }
  }

  let spectraTop = 1;
  const spectraPlot = plot(
    "spectra",
    {
      scales: {
        x: { time: false, distr: 3, range: (u, least, most) => [LOWEST, most || 500] },
        y: { distr: 3, range: () => [spectraTop / 10 ** DECADES, spectraTop] },
      },
      series: [
        {},
        { stroke: () => colour.desired, width: 2, points: { show: false } },
        { stroke: () => colour.actual, width: 1.4, points: { show: false } },
      ],
      axes: [
        axis("frequency (Hz)"),
        axis("m/s²/√Hz", {
          size: 62,
          values: (u, splits) => splits.map((v) => (v === null ? "" : String(+v.toPrecision(1)))),
        }),
      ],
    },
    [[LOWEST, 500], [null, null], [null, null]],
  );

  const cloudLimit = new Limit(1);
  const cloudPlot = plot(
    "cloud",
    {
      scales: {
        x: { time: false, range: () => [-cloudLimit.value, cloudLimit.value] },
        y: { range: () => [-cloudLimit.value, cloudLimit.value] },
      },
      series: [{}, {}],
      axes: [axis("actual (m/s²)"), axis("desired (m/s²)", { size: 52 })],
      hooks: { draw: [drawCloud] },
    },
    [[-1, 1], [null, null]],
  );

  function drawCloud(u) {
    if (!plots) return;
    const { ctx, bbox: box } = u;
    clipped(ctx, box, () => {
      const limit = cloudLimit.value;
      const x = (value) => box.left + (0.5 + value / (2 * limit)) * box.width;
      const y = (value) => box.top + (0.5 - value / (2 * limit)) * box.height;
      const line = (slope, stroke, width, dash) => {
        ctx.beginPath();
        ctx.setLineDash(dash.map((length) => length * devicePixelRatio));
        ctx.moveTo(x(-limit), y(-limit * slope));
        ctx.lineTo(x(limit), y(limit * slope));
        ctx.strokeStyle = stroke;
        ctx.lineWidth = width * devicePixelRatio;
        ctx.stroke();
      };
      const size = 2 * devicePixelRatio;
      ctx.fillStyle = colour.desired;
      ctx.globalAlpha = 0.55;
      for (let i = 0; i < plots.actual.length; i++) {
        ctx.fillRect(x(plots.actual[i]) - size / 2, y(plots.cloud[i]) - size / 2, size, size);
      }
      ctx.globalAlpha = 1;
      line(1, colour.quiet, 1, [5, 4]);
      const slope = state?.metrics.slope;
      if (slope !== null && slope !== undefined) line(slope, colour.actual, 2.2, []);
    });
  }

  function showPlots() {
    const { frequency, desiredSpectrum, actualSpectrum } = plots;
    if (frequency.length) {
      const first = frequency.findIndex((f) => f >= LOWEST);
      const positive = (values) => Array.from(values.subarray(first), (v) => (v > 0 ? v : null));
      const lines = [positive(desiredSpectrum), positive(actualSpectrum)];
      const top = Math.max(LEAST_TOP, ...lines.flat());
      const wanted = 10 ** Math.ceil(Math.log10(top));
      if (wanted > spectraTop || wanted < spectraTop / 10) spectraTop = wanted;
      spectraPlot.setData([Array.from(frequency.subarray(first)), ...lines]);
    }
    const sizes = Float32Array.of(...plots.actual, ...plots.cloud).map(Math.abs).sort();
    const usual = sizes.length ? sizes[Math.floor(CLOUD_SHARE * sizes.length)] : 0;
    if (cloudLimit.meet(CLOUD_ROOM * usual)) cloudPlot.setData(cloudPlot.data);
    else cloudPlot.redraw(false, false);
  }

  // ---- Gauges -----------------------------------------------------------------------------

  function drawGauge(name, limit) {
    const track = document.querySelector(`[data-gauge=${name}] .track`);
    const trace = traces[name];
    const fresh = clock.now - trace.newest < QUIET;
    const [least, most] = fresh ? trace.extremes(trace.newest - BAND) : [0, 0];
    const part = (value) => Math.max(-1, Math.min(1, value / limit));
    track.querySelector(".now").style.transform = `scaleX(${part(fresh ? trace.last : 0)})`;
    track.querySelector(".band").style.transform =
      `translateX(${100 * part(least)}%) scaleX(${part(most) - part(least)})`;
    track.dataset.full = String(Math.max(-least, most) >= 0.95 * limit);
  }

  function drawGauges() {
    const limits = state?.limits;
    if (!limits) return;
    drawGauge("force", limits.force);
    drawGauge("travel", limits.travel);
  }

  // ---- States -----------------------------------------------------------------------------

  const digits = (value, places, factor = 1) =>
    value === null || value === undefined ? "–" : (factor * value).toFixed(places);

  function showNumbers(numbers) {
    setText(byId("nrmse"), digits(numbers.nrmse_percent, 1));
    setText(byId("slope"), digits(numbers.slope, 2));
    setText(byId("r2"), digits(numbers.r2, 2));
    setText(byId("rms_desired"), digits(numbers.rms_desired, 2));
    setText(byId("rms_actual"), digits(numbers.rms_actual, 2));
    setText(byId("age_p50"), digits(numbers.age_p50, 0, 1e6));
    setText(byId("age_p99"), digits(numbers.age_p99, 0, 1e6));
    setText(byId("rate"), digits(numbers.rate, 0));
    setText(byId("force-peak"), digits(numbers.peak_force, 2));
    setText(byId("travel-peak"), digits(numbers.peak_travel, 2, 1e3));
  }

  function showNodes(rows) {
    const list = byId("nodes");
    for (const row of rows) {
      let item = list.querySelector(`[data-node="${CSS.escape(row.name)}"]`);
      if (!item) {
        item = document.createElement("li");
        item.dataset.node = row.name;
        for (const kind of ["who", "state", "say"]) {
          const part = document.createElement("span");
          part.className = kind;
          item.append(part);
        }
        list.append(item);
      }
      const [who, badge, say] = item.children;
      const before = badge.dataset.state;
      setText(who, row.name);
      setState(badge, row.state, row.state);
      setText(say, row.message);
      // The emergency stop has its own display.
      const news = before && !lost && before !== row.state && row.state !== "OK";
      if (news && row.message !== "emergency stop") {
        tell(`${row.name}: ${row.message || row.state}`, row.state);
      }
    }
  }

  const UNHEARD = new Set(["absent", "silent"]); // states of nodes that report nothing
  const HIDDEN_FACTS = new Set(["scheduling", "state"]);

  /** Name and value of a fact for display: bytes as a rounded size. */
  function readable([name, value]) {
    const [, plain] = name.match(/^(.*) [[(]bytes[\])]$/) ?? [];
    if (!plain) return [name, value];
    const mega = Number(value) / 1e6;
    return [plain, mega < 1e3 ? `${mega.toFixed(1)} MB` : `${(mega / 1e3).toFixed(1)} GB`];
  }

  function showRecorder(rows, facts) {
    const row = rows.find(({ name }) => name === "recorder");
    const words = { OK: facts.state || "recording", absent: "not recording" };
    setState(byId("recorder-state"), row.state, words[row.state] || row.message || row.state);
    const shown = Object.entries(facts)
      .filter(([name]) => !HIDDEN_FACTS.has(name))
      .map(readable);
    const list = byId("recorder");
    const names = shown.map(([name]) => name).join("\n");
    if (list.dataset.names !== names) {
      list.dataset.names = names;
      list.replaceChildren(
        ...shown.map(([name]) => {
          const [group, term, value] = ["div", "dt", "dd"].map((k) => document.createElement(k));
          term.textContent = name;
          group.append(term, value);
          return group;
        }),
      );
    }
    shown.forEach(([, value], index) => setText(list.children[index].lastChild, value));
  }

  function showChoice(action, value) {
    const output = byId(action);
    if (output) setText(output, value ?? "unknown");
    let known = false;
    for (const button of document.querySelectorAll(`[data-action=${action}]`)) {
      const chosen = button.dataset.value === String(value);
      known ||= chosen;
      if (button.getAttribute("aria-pressed") !== String(chosen)) {
        button.setAttribute("aria-pressed", String(chosen));
      }
    }
    if (output && control) output.classList.toggle("hidden", known);
  }

  function showStop(stop, engaged, rows, numbers) {
    // Beside a peer host there is one arm here.
    const devices = ["master", "slave"].filter((arm) => stop[arm] !== undefined);
    const answers = devices.map((arm) => stop[arm]);
    const stopped = stop.asked || answers.includes(true);
    const all = answers.every((answer) => answer === true);
    // A device reports nothing about the stop before the first one.
    const heard = new Set(rows.filter((row) => !UNHEARD.has(row.state)).map((row) => row.name));
    const known = devices.length && devices.every((arm) => heard.has(`${arm}_device`));
    const free = known ? ["OK", "no stop"] : ["absent", "stop: unknown"];
    setState(byId("stop-state"), ...(stopped ? ["error", "emergency stop"] : free));
    // Without vibration of the tool there is nothing to compare.
    const idle = numbers.rms_desired !== undefined && numbers.nrmse_percent === undefined;
    const coupled = idle ? ["warning", "arms engaged, no contact"] : ["OK", "arms engaged"];
    const arms = engaged ? coupled : ["warning", "arms disengaged"];
    setState(byId("arms"), ...(engaged === null ? ["absent", "arms: unknown"] : arms));
    const alarm = byId("alarm");
    const text = all
      ? "Emergency stop: no force until it is released."
      : "Emergency stop: not confirmed by every device.";
    setText(alarm, stopped ? text : "");
    alarm.hidden = !stopped;
    if (control) byId("release").hidden = !stopped;
  }

  function describe() {
    if (!state || lost) return;
    const n = state.metrics;
    const rms = `desired ${digits(n.rms_desired, 1)}, actual ${digits(n.rms_actual, 1)} m/s² RMS`;
    byId("time").setAttribute("aria-label", `Acceleration over the last seconds: ${rms}`);
    byId("cloud").setAttribute(
      "aria-label",
      `Desired against actual acceleration: slope ${digits(n.slope, 2)}, R² ${digits(n.r2, 2)}`,
    );
    for (const [name, factor, unit] of [["force", 1, "N"], ["travel", 1e3, "mm"]]) {
      const track = document.querySelector(`[data-gauge=${name}] .track`);
      const limit = state.limits[name] * factor;
      const peak = (n[`peak_${name}`] ?? 0) * factor;
      track.setAttribute("aria-valuemax", limit.toFixed(2));
      track.setAttribute("aria-valuenow", Math.min(peak, limit).toFixed(2));
      track.setAttribute("aria-valuetext", `peak ${peak.toFixed(2)} of ${limit.toFixed(2)} ${unit}`);
    }
  }

  let version = null;

  function showState(received) {
    if (received.refused) {
      hapticScene.letGo();
      tell(received.refused, "error");
      return;
    }
    if (version !== null && version !== received.version) {
      location.reload(); // another scope, with other controls
      return;
    }
    version = received.version;
    state = received;
    counters.states++;
    if (held === null) showNumbers(state.metrics);
    const { age_us, due, missed, latest_us } = state.actuator;
    setText(byId("actuator_age"), digits(age_us, 0));
    setText(byId("deadlines"), due ? `${missed} of ${due}` : "–");
    setText(byId("latest"), digits(due ? latest_us : null, 2, 1e-3));
    setText(byId("force-limit"), digits(state.limits.force, 1));
    setText(byId("travel-limit"), digits(state.limits.travel, 1, 1e3));
    byId("assumed").hidden = !state.limits.assumed;
    showNodes(state.nodes);
    showRecorder(state.nodes, state.recorder);
    hapticScene.show(state);
    for (const action of ["controller", "surface", "grip"]) showChoice(action, state[action]);
    showChoice("engage", state.engaged);
    showStop(state.stop, state.engaged, state.nodes, state.metrics);
    retry = FIRST_RETRY;
    shownAt = performance.now();
    [lost, trouble] = [false, ""];
    document.body.classList.remove("lost");
    watch();
  }

  // ---- Age of what is shown ---------------------------------------------------------------

  let shownAt = performance.now(); // when the last state was shown
  let lost = false; // no state came for too long: what is shown may be out of date
  let trouble = ""; // reason, if it is known

  function showAge() {
    if (age.now === null) {
      setState(byId("link"), "waiting", "no signals");
      return;
    }
    const size = Math.abs(age.now);
    const when = age.now < -OLD ? "ahead of the scope's clock" : "old";
    const text = `data ${size.toFixed(size < 10 ? 2 : 0)} s ${when}`;
    setState(byId("link"), size < OLD ? "OK" : "warning", text);
  }

  /** Show what was known as unknown. */
  function lose() {
    lost = true;
    document.body.classList.add("lost");
    setState(byId("stop-state"), "absent", "stop: unknown");
    setState(byId("arms"), "absent", "arms: unknown");
    setState(byId("recorder-state"), "absent", "unknown");
    for (const badge of document.querySelectorAll("#nodes .state")) setState(badge, "absent", "unknown");
    setText(byId("alarm"), byId("alarm").hidden ? "" : "Emergency stop when last heard of; now unknown.");
  }

  /** Show the age of what is seen, and its loss, whatever the scope or this tab was held up by. */
  function watch() {
    const silence = performance.now() - shownAt;
    if (silence < LOST && !trouble) {
      if (!lost) showAge();
      return;
    }
    if (!lost) lose();
    const time = `no data for ${(silence / 1000).toFixed(1)} s`;
    setState(byId("link"), "error", trouble ? `${trouble}, ${time}` : time);
    // A connection that broke without a word stays open here for ever.
    const renewed = performance.now() - openedAt > RENEW;
    if (silence > RENEW && renewed && socket.readyState === WebSocket.OPEN) {
      const silent = socket;
      connect();
      silent.close();
    }
  }

  // ---- The link to the scope --------------------------------------------------------------

  function take(buffer) {
    const kind = new DataView(buffer).getUint32(0, true);
    counters.frames++;
    counters.bytes += buffer.byteLength;
    if (kind === SAMPLES) takeSamples(buffer);
    else if (kind === PLOTS) takePlots(buffer);
    else if (kind === PLACED) hapticScene.take(buffer);
  }

  function takeSamples(buffer) {
    const view = new DataView(buffer);
    const counts = TRACES.map((_, index) => view.getUint32(4 + 4 * index, true));
    let place = 4 + 4 * TRACES.length;
    const sentAge = view.getFloat32(place, true);
    const [sentAt, origin] = [4, 12].map((after) => view.getFloat64(place + after, true));
    place += 20;
    const block = (count) => {
      const values = new Float32Array(buffer, place, count);
      place += 4 * count;
      return values;
    };
    TRACES.forEach((name, index) => {
      const offsets = block(counts[index]);
      const values = block(counts[index]);
      traces[name].push(origin, offsets, values);
      hapticSound.take(name, origin, offsets, values, state?.metrics.rate);
    });
    clock.meet(Math.max(traces.desired.newest, traces.actual.newest));
    age.meet(sentAge, sentAt);
  }

  function takePlots(buffer) {
    const view = new DataView(buffer);
    const [lines, points] = [4, 8].map((at) => view.getUint32(at, true));
    let place = 12;
    const block = (count) => {
      const values = new Float32Array(buffer, place, count);
      place += 4 * count;
      return values;
    };
    const [frequency, desiredSpectrum, actualSpectrum] = [0, 1, 2].map(() => block(lines));
    const [cloud, actual] = [0, 1].map(() => block(points));
    if (held !== null) return;
    plots = { frequency, desiredSpectrum, actualSpectrum, cloud, actual };
    showPlots();
  }

  let retry = FIRST_RETRY;
  let socket = null;
  let openedAt = -Infinity; // ms, when a connection was tried last

  function send(value) {
    if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(value));
  }

  function askForSignals() {
    const scene = hapticScene.inSight ? ["scene"] : [];
    const sound = hapticSound.on ? ["sound"] : [];
    send([...ON_DEMAND.filter((name) => chosen.has(name)), ...scene, ...sound]);
  }

  function connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const opened = new WebSocket(`${scheme}://${location.host}/live`);
    socket = opened;
    openedAt = performance.now();
    opened.binaryType = "arraybuffer";
    // One that was given up says nothing more.
    const listen = (event, act) =>
      opened.addEventListener(event, (given) => socket === opened && act(given));
    listen("open", () => {
      for (const trace of Object.values(traces)) trace.count = 0; // the last seconds come again
      age.forget();
      hapticScene.forget();
      askForSignals();
    });
    listen("message", ({ data }) => {
      if (typeof data !== "string") {
        take(data);
        return;
      }
      try {
        showState(JSON.parse(data));
      } catch (fault) {
        trouble = "this page failed";
        console.error(fault);
      }
    });
    listen("close", ({ code }) => {
      trouble = code === INTERNAL_ERROR ? "the scope failed, see its log" : "scope not reached";
      watch();
      setTimeout(connect, retry);
      if (retry === LAST_RETRY) checkToken();
      retry = Math.min(2 * retry, LAST_RETRY);
    });
  }

  /** A restarted scope may have another token; a socket does not report that. */
  async function checkToken() {
    try {
      const answer = await fetch("/", { method: "HEAD" });
      if (answer.status === 403) tell("open the address that the scope printed last", "error");
    } catch {
      // not reachable, which is shown already
    }
  }

  // ---- Commands ---------------------------------------------------------------------------

  let hiding = 0;

  function tell(text, kind) {
    const message = byId("message");
    message.hidden = false;
    setState(message, kind, text);
    clearTimeout(hiding);
    if (kind !== "waiting") hiding = setTimeout(() => (message.hidden = true), SAID);
  }

  async function command(action, value) {
    try {
      const answer = await fetch("/command", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ action, value }),
        signal: AbortSignal.timeout(COMMAND_TIME),
      });
      const { message } = await answer.json();
      tell(message, answer.ok ? "OK" : "error");
      return answer.ok;
    } catch {
      const urgent = action === "estop" && value;
      tell(
        urgent
          ? "The stop did not reach the scope. Use the hardware, or haptic-accel estop."
          : `${action}: the scope does not answer`,
        "error",
      );
      return false;
    }
  }

  function stop() {
    tell("stopping", "waiting");
    return command("estop", true);
  }

  function listenToControls() {
    for (const button of document.querySelectorAll("[data-action]")) {
      button.addEventListener("click", async () => {
        const { action, value } = button.dataset;
        button.setAttribute("aria-busy", "true");
        await command(action, action === "engage" ? value === "true" : value);
        button.removeAttribute("aria-busy");
      });
    }
    const confirm = byId("confirm");
    byId("stop").addEventListener("click", stop);
    byId("release").addEventListener("click", () => confirm.showModal());
    byId("keep").addEventListener("click", () => confirm.close());
    byId("really").addEventListener("click", () => {
      confirm.close();
      command("estop", false);
    });
    document.addEventListener("keydown", (event) => {
      // In the dialog, Escape closes the dialog and everything stays stopped.
      if (event.key === "Escape" && !event.repeat && !confirm.open) stop();
    });
  }

  // ---- Drawing ----------------------------------------------------------------------------

  let drawnAt = 0;
  let plottedAt = 0; // when the plots over time were drawn last
  let plotsRest = 0; // ms that they then leave to the scene and the sound

  function draw(moment) {
    requestAnimationFrame(draw);
    const pause = calm.matches && !hapticScene.gripped ? CALM : hapticSound.heldUp ? HEARD : 0;
    if (moment - drawnAt < pause) return;
    // A picture that comes late shows what the plots in the one before have cost.
    if (plottedAt === drawnAt) plotsRest = LEFT * Math.max(0, moment - drawnAt - PROMPT);
    drawnAt = moment;
    hapticScene.draw();
    if (clock.offset === null || held !== null) return;
    counters.drawn++;
    if (moment - plottedAt < plotsRest) return;
    plottedAt = moment;
    for (const strip of strips) strip.draw();
    drawGauges();
  }

  byId("window").addEventListener("change", ({ target }) => {
    windowLength = Number(target.value);
    for (const strip of strips) strip.reset();
  });
  byId("hold").addEventListener("click", () => setHold(held === null));
  byId("hold").addEventListener("keydown", ({ key }) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (held && step) for (const strip of strips) strip.moveCursor(step);
  });
  for (const name of TRACES) {
    const box = byId(`show-${name}`);
    box.checked = chosen.has(name);
    box.style.accentColor = `var(--${name})`;
    box.addEventListener("change", () => choose(name, box.checked));
  }
  showSignals();
  dark.addEventListener("change", () => {
    colour = colours();
    for (const one of [...strips.map((strip) => strip.plot), spectraPlot, cloudPlot, hapticScene]) one.redraw();
  });
  setInterval(describe, DESCRIBE);
  setInterval(watch, WATCH);
  document.addEventListener("visibilitychange", watch); // the interval is longer while hidden
  hapticScene.start({ send, ask: askForSignals, plot, axis, colour: () => colour });
  hapticSound.start(askForSignals);
  if (control) listenToControls();
  connect();
  requestAnimationFrame(draw);

  /** Counts of what was received and drawn so far, for tests and debugging. */
  window.hapticScope = {
    counters,
    get state() {
      return state;
    },
    samples: () => Object.fromEntries(TRACES.map((name) => [name, traces[name].count])),
    newest: () => traces.actual.newest,
    view: () => [strips[0].plot.scales.x.min, strips[0].plot.scales.x.max],
  };
})();
