// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plots of a trial's amplitude spectra and coherence, on its own or beside other controllers.
import { draw, legend, line, upright } from "./analysis_chart.js";
import { data, viewed } from "./analysis_data.js";
import { axis } from "./axes.js";

const LOWEST = 10; // Hz
const DECADES = 4.5; // most that an axis of amplitudes spans
const CURVES = 6; // colours of the page for curves that are compared
const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [4, 4]];

/** Ticks at 1, 2 and 5 of every decade; evenly spaced ones where too few of these are in sight. */
const TICKS = {
  splits: (_u, _axis, low, high) => {
    const found = [];
    for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power += 1) {
      found.push(...[1, 2, 5].map((digit) => digit * 10 ** power).filter((at) => at >= low && at <= high));
    }
    return found.length > 1 ? found : [1, 2, 3].map((i) => low + ((high - low) * i) / 4);
  },
  values: (_u, at) => at.map((value) => String(Number(value.toPrecision(2)))),
  filter: (_u, at) => at,
};

/** The trial, and the first of each other controller on the same surface if these are wanted. */
function compared(trial, others) {
  const same = data.trials.map(viewed).filter((t) => others && t.surface === trial.surface && t.spectra);
  const first = new Map();
  for (const one of [trial, ...same]) {
    if (!first.has(one.controller)) first.set(one.controller, one);
  }
  return [...first.values()];
}

/** Draw spectra in m/s²/√Hz and coherence, over frequencies in Hz. */
export function drawSpectra(trial, { logarithmic, others }) {
  if (!trial.spectra) {
    draw("spectra", {}, null);
    draw("coherence", {}, null);
    return;
  }
  const { step, desired } = trial.spectra;
  const first = Math.ceil(LOWEST / step);
  const frequencies = desired.map((_, i) => i * step).slice(first);
  const part = (values) => values.slice(first).map((v) => (logarithmic && v <= 0 ? null : v));
  const amplitudes = [part(desired)];
  const coherences = [];
  const curves = [line("desired", "desired", 4, "", { width: 2.5 })];
  const coherent = [];
  compared(trial, others).forEach((one, index) => {
    const curve = `curve-${index % CURVES}`;
    const more = { dash: DASHES[index % DASHES.length] };
    curves.push(line(others ? one.controller : "actual", curve, 4, "", more));
    coherent.push(line(...(others ? [one.controller, curve] : ["coherence", "curve-2"]), 2, "", more));
    amplitudes.push(part(one.spectra.actual));
    coherences.push(one.spectra.coherence.slice(first));
  });
  const top = 2 * Math.max(...amplitudes.flat().filter(Number.isFinite), 1e-9);
  const positive = amplitudes.flat().filter((v) => v > 0);
  const bottom = Math.max(Math.min(...positive, top), top * 10 ** -DECADES);
  // The scale ends where the data do: on its own, a logarithmic one goes on to the next decade.
  const range = (_u, low, high) => [Math.max(low, frequencies[0]), Math.min(high, frequencies.at(-1))];
  const over = (id, name, label, size, series, y, values) => {
    const options = {
      name: `${name} of ${trial.name}`,
      series: [legend("frequency", 0, " Hz"), ...series],
      scales: { x: { time: false, distr: logarithmic ? 3 : 1, range }, y },
      axes: [axis("frequency (Hz)", logarithmic ? TICKS : {}), upright(label, size)],
    };
    draw(id, options, [frequencies, ...values]);
  };
  const heights = logarithmic ? { distr: 3, range: [bottom, top] } : {};
  over("spectra", "Amplitude spectra", "m/s²/√Hz", { size: 62 }, curves, heights, amplitudes);
  over("coherence", "Coherence", "coherence", {}, coherent, { range: [0, 1.02] }, coherences);
}
