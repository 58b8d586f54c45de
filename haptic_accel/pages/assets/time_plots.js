// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plots of the signals over time: they follow, or are held so that values can be read.
import { axis, colour } from "./axes.js";
import { serverClock } from "./clocks.js";
import { byId, digits, press, setText } from "./elements.js";
import { Limit, SHRINK, clear, clipped, livePlot, sheetOver } from "./live_plot.js";
import { chosen, listenToSignals } from "./signals.js";
import { drawTrace } from "./trace_bars.js";
import { TRACES, traces } from "./traces.js";

const LAG = 0.05; // s behind the newest sample, so that the right edge does not flicker
const HINT = "To read the curves, point at them, or press the left and right arrow keys. "
  + "Drag to zoom; double-click for the whole window.";

let windowLength = Number(byId("window").value); // s

/** Time at the right edge, s since 1970, and the traces as they were, while the plots are held; or null. */
export let held = null;

/** Plot of traces of one unit over time. */
class TimePlot {
  constructor(id, unit, factor, places, least, names) {
    Object.assign(this, { holder: byId(id), unit, factor, places, names, limit: new Limit(least) });
    const options = {
      scales: {
        x: { time: false },
        y: { range: () => [-1, 1].map((sign) => sign * factor * this.limit.value) },
      },
      series: [{}, {}],
      axes: [axis("time before now (s)"), axis(unit, { size: 52 })],
      cursor: { y: false, points: { show: false }, sync: { key: "time" } },
      hooks: { draw: [() => held && this.draw()], setCursor: [readCursor] },
    };
    this.plot = livePlot(this.holder, options, this.wholeWindow());
    // The traces have a canvas of their own: the axes behind it are redrawn rarely.
    this.sheet = sheetOver(this.holder);
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
    const source = held ?? { time: serverClock.now - LAG, traces };
    const window = [plot.scales.x.min, plot.scales.x.max].map((time) => source.time + time);
    const extremes = shown.flatMap((name) => source.traces[name].extremes(...window));
    if (limit.meet(Math.max(...extremes.map(Math.abs)), held ? 0 : SHRINK)) {
      queueMicrotask(() => plot.redraw()); // in the hook that calls this, it would be ignored
    }
    clear(sheet, plot.ctx.canvas);
    clipped(sheet, plot.bbox, () => {
      for (const name of shown) {
        // The first is behind, and shows through the second.
        const first = name === this.names[0];
        sheet.globalAlpha = first ? 1 : 0.85;
        sheet.fillStyle = colour(name);
        drawTrace(sheet, plot.bbox, source.traces[name], window, limit.value, first ? 2 : 1.2);
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
      const value = held.traces[name].near(held.time + before);
      const words = byId(`show-${name}`).closest("label").textContent.trim();
      return `${words} ${digits(value, this.places, this.factor)} ${this.unit}`;
    });
  }
}

/** The plots: in m/s², N and mm, of traces in SI units. */
export const timePlots = [
  new TimePlot("time", "m/s²", 1, 2, 1, ["desired", "actual"]),
  new TimePlot("forces", "N", 1, 3, 0.1, ["force", "arm_force"]),
  new TimePlot("positions", "mm", 1e3, 3, 1e-4, ["travel", "position"]),
];

function readCursor(plot) {
  if (!held) return;
  const at = plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : null;
  const values = at === null ? [] : timePlots.flatMap((one) => one.read(at));
  setText(byId("reading"), at === null ? HINT : `${at.toFixed(4)} s: ${values.join(", ")}`);
}

function setHold(hold) {
  const copies = () => Object.fromEntries(TRACES.map((name) => [name, traces[name].copy()]));
  held = hold ? { time: serverClock.now - LAG, traces: copies() } : null;
  press(byId("hold"), hold);
  byId("reading").hidden = !hold;
  for (const { holder, plot } of timePlots) {
    holder.classList.toggle("held", hold);
    plot.setCursor({ left: -10, top: -10 });
  }
  for (const one of timePlots) one.reset();
}

function showChosen() {
  for (const { holder, shown, plot } of timePlots) {
    holder.hidden = !shown.length;
    if (held) plot.redraw();
  }
}

/** Let the user choose signals and window, hold the plots and read them. */
export function listenToTimePlots() {
  listenToSignals(showChosen);
  showChosen();
  byId("window").addEventListener("change", ({ target }) => {
    windowLength = Number(target.value);
    for (const one of timePlots) one.reset();
  });
  byId("hold").addEventListener("click", () => setHold(held === null));
  byId("hold").addEventListener("keydown", ({ key }) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (held && step) for (const one of timePlots) one.moveCursor(step);
  });
}
