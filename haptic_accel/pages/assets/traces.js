// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Ring buffers of the signals that the scope sends.

export const ON_DEMAND = ["arm_force", "position"]; // sent only if they are asked for
export const TRACES = ["desired", "actual", "force", "travel", ...ON_DEMAND]; // as in frames of samples
const CAPACITY = 1 << 17; // samples of a trace; at 20 kHz more than the longest window
export const GAP = 0.02; // s without a sample across which no line is drawn

/** The newest samples of a signal, numbered from its first: times in s since 1970, values in SI units. */
class Trace {
  constructor() {
    this.times = new Float64Array(CAPACITY);
    this.values = new Float32Array(CAPACITY);
    this.count = 0;
  }

  /** Add samples: times in s after an origin in s since 1970, and their values. */
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

  time(number) {
    return this.times[number % CAPACITY];
  }

  value(number) {
    return this.values[number % CAPACITY];
  }

  /** Number of the oldest sample that is kept. */
  get oldest() {
    return Math.max(0, this.count - CAPACITY);
  }

  get newest() {
    return this.count ? this.time(this.count - 1) : -Infinity;
  }

  get last() {
    return this.count ? this.value(this.count - 1) : NaN;
  }

  /** Number of the first sample that is not before a time, s. */
  since(time) {
    let low = this.oldest;
    let high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Value of the sample nearest to a time, s; NaN if there is none near it. */
  near(time) {
    const after = this.since(time);
    const [before, next] = [after - 1, after].map((i) => Math.abs(this.time(i) - time));
    return Math.min(before, next) < GAP ? this.value(after - (before < next)) : NaN;
  }

  /** Least and greatest value from one time to another, s. */
  extremes(time, end = Infinity) {
    let least = Infinity;
    let greatest = -Infinity;
    for (let i = this.since(time); i < this.count && this.time(i) <= end; i++) {
      const value = this.value(i);
      if (value < least) least = value;
      if (value > greatest) greatest = value;
    }
    return least <= greatest ? [least, greatest] : [0, 0];
  }
}

/** The signals by name: accelerations in m/s², forces in N, travel and position in m. */
export const traces = Object.fromEntries(TRACES.map((name) => [name, new Trace()]));
