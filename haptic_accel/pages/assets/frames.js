// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Decodes the frames that are described in haptic_accel/scope/state.py.
import { TRACES } from "./traces.js";

/** Places of a frame of places: m, m/s, m, N, each along x and z. */
export const PLACES = ["tool", "velocity", "handle", "force"];

const AXES = ["x", "y", "z"];

class Reader {
  constructor(buffer) {
    this.view = new DataView(buffer);
    this.place = 0;
  }

  /** Number of a type, whose size is in bytes. */
  number(type, size) {
    this.place += size;
    return this.view[`get${type}`](this.place - size, true);
  }

  counts(many) {
    return Array.from({ length: many }, () => this.number("Uint32", 4));
  }

  floats(count) {
    this.place += 4 * count;
    return new Float32Array(this.view.buffer, this.place - 4 * count, count);
  }
}

function samples(reader) {
  const [axis, ...counts] = reader.counts(1 + TRACES.length);
  const age = reader.number("Float32", 4);
  const [sent, origin] = [0, 1].map(() => reader.number("Float64", 8));
  const signals = TRACES.map((name, index) => {
    const [offsets, values] = [0, 1].map(() => reader.floats(counts[index]));
    return { name, offsets, values };
  });
  return { kind: "samples", axis: AXES[axis], age, sent, origin, signals };
}

function plots(reader) {
  const [lines, points] = reader.counts(2);
  const [frequency, ...spectra] = [0, 1, 2].map(() => reader.floats(lines));
  const [desired, actual] = [0, 1].map(() => reader.floats(points));
  return { kind: "plots", frequency, spectra, desired, actual };
}

function placesOf(reader) {
  const found = PLACES.map((name) => [name, [...reader.floats(2)]]);
  return { kind: "places", places: Object.fromEntries(found) };
}

/**
 * Decode a frame.
 *
 * @param {ArrayBuffer} buffer
 * @returns {object} its kind and content: "samples" with their axis, age in s, when they were sent in s of
 *   a steady clock, and times in s after an origin in s since 1970; "plots" with frequencies in Hz,
 *   desired and actual spectrum in m/s²/√Hz, and the cloud's accelerations in m/s²; or "places" in
 *   m, m/s and N
 */
export function decode(buffer) {
  const reader = new Reader(buffer);
  const [number] = reader.counts(1);
  return { 1: samples, 2: plots, 3: placesOf }[number]?.(reader) ?? {};
}
