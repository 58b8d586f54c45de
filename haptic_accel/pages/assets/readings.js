// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Metrics and gauges, and what screen readers are told of the plots.
import { serverClock } from "./clocks.js";
import { byId, digits, setText } from "./elements.js";
import { traces } from "./traces.js";

const BAND = 1.0; // s whose range the pale band of a gauge shows
const QUIET = 1.0; // s without samples after which a gauge shows nothing
const FULL = 0.95; // of its limit, from which on a gauge warns

// Quantity, factor to the unit that is shown, that unit.
const GAUGES = [["force", 1, "N"], ["travel", 1e3, "mm"]];

const trackOf = (name) => document.querySelector(`[data-gauge=${name}] .track`);

/** Show the metrics of the last seconds, by name, where the page says with which digits and factor. */
export function showNumbers(metrics) {
  for (const place of document.querySelectorAll("[data-metric]")) {
    const { metric, digits: places, factor } = place.dataset;
    setText(place, digits(metrics[metric], places, factor));
  }
}

/** Show how the actuator's forces kept their deadlines, in µs, and its limits in N and m. */
export function showActuator({ age_us, due, missed, latest_us }, limits) {
  setText(byId("actuator_age"), digits(age_us, 0));
  setText(byId("deadlines"), due ? `${missed} of ${due}` : "–");
  setText(byId("latest"), digits(due ? latest_us : null, 2, 1e-3));
  for (const [name, factor] of GAUGES) setText(byId(`${name}-limit`), digits(limits[name], 1, factor));
  byId("assumed").hidden = !limits.assumed;
}

/** Draw force and travel relative to their limits in N and m. */
export function drawGauges(limits) {
  for (const [name] of GAUGES) {
    const track = trackOf(name);
    const trace = traces[name];
    const fresh = serverClock.now - trace.newest < QUIET;
    const [least, most] = fresh ? trace.extremes(trace.newest - BAND) : [0, 0];
    const part = (value) => Math.max(-1, Math.min(1, value / limits[name]));
    track.querySelector(".now").style.transform = `scaleX(${part(fresh ? trace.last : 0)})`;
    track.querySelector(".band").style.transform =
      `translateX(${100 * part(least)}%) scaleX(${part(most) - part(least)})`;
    track.dataset.full = String(Math.max(-least, most) >= FULL * limits[name]);
  }
}

/** Describe plots and gauges for screen readers, from metrics and limits in SI units. */
export function describe({ metrics: n, limits }) {
  const say = (id, text) => byId(id).setAttribute("aria-label", text);
  const rms = `desired ${digits(n.rms_desired, 1)}, actual ${digits(n.rms_actual, 1)} m/s² RMS`;
  say("time", `Acceleration over the last seconds: ${rms}`);
  const fit = `slope ${digits(n.slope, 2)}, R² ${digits(n.r2, 2)}`;
  say("cloud", `Desired against actual acceleration: ${fit}`);
  for (const [name, factor, unit] of GAUGES) {
    const track = trackOf(name);
    const limit = limits[name] * factor;
    const peak = (n[`peak_${name}`] ?? 0) * factor;
    track.setAttribute("aria-valuemax", limit.toFixed(2));
    track.setAttribute("aria-valuenow", Math.min(peak, limit).toFixed(2));
    track.setAttribute("aria-valuetext", `peak ${peak.toFixed(2)} of ${limit.toFixed(2)} ${unit}`);
  }
}
