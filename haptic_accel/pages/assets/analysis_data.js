// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The trials of the page, which stand in it as JSON.
import { byId } from "./elements.js";

/** What the page was written with: `trials`, `excerpt` in s, and the `first` trial to show. */
export const data = JSON.parse(byId("data").textContent);

const traces = new Map();

/** The axis that is shown of trials with several. */
export const shown = { axis: "z" };

/** Return a trial as it is drawn: of several axes, the one that is shown. */
export function viewed(trial) {
  if (!trial.axes) return trial;
  const axis = shown.axis in trial.axes ? shown.axis : Object.keys(trial.axes)[0];
  return { ...trial, ...trial.axes[axis], axis };
}

/** Return the values of a signal that is packed as 16-bit integers, in its own unit. */
export function unpacked(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const value = (_, i) => view.getInt16(2 * i, true) * packed.scale;
  return Float64Array.from({ length: bytes.length / 2 }, value);
}

/** Return the signals of a trial's axis, in its part "whole" or "detail", and their `time` in s. */
export function trace(trial, part) {
  const found = everything(trial, part);
  if (!trial.axis) return found;
  const end = `_${trial.axis}`;
  const own = Object.keys(found).filter((name) => name.endsWith(end));
  const signals = Object.fromEntries(own.map((name) => [name.slice(0, -end.length), found[name]]));
  return { ...signals, time: found.time };
}

/** Return the signals of all axes of a trial's part; those of several end in the axis. */
export function everything(trial, part) {
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
