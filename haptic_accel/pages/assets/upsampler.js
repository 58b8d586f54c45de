// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Changes the rate of samples to that of a sound card.

/** Input samples on each side of the interpolation filter; its delay. */
export const HALF = 4;
const PHASES = 1024; // positions between two input samples that the filter is tabulated at
const SHARPNESS = 5; // of the Kaiser window: flat up to 0.3 of the rate, images of that 53 dB down

/** Modified Bessel function of the first kind, order zero. */
function bessel(x) {
  let [sum, term] = [1, 1];
  for (let k = 1; term > 1e-9 * sum; k++) sum += term *= (x / (2 * k)) ** 2;
  return sum;
}

/** Taps of a windowed sinc by position between two samples, each position's of sum one. */
const KERNEL = new Float32Array(PHASES * 2 * HALF);
for (let phase = 0; phase < PHASES; phase++) {
  const taps = KERNEL.subarray(2 * HALF * phase, 2 * HALF * (phase + 1));
  taps.forEach((_, tap) => {
    const x = phase / PHASES + HALF - 1 - tap;
    const window = bessel(SHARPNESS * Math.sqrt(Math.max(0, 1 - (x / HALF) ** 2)));
    taps[tap] = window * (x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x));
  });
  const sum = taps.reduce((a, b) => a + b);
  taps.forEach((value, tap) => (taps[tap] = value / sum));
}

/** Interpolates a stream that comes in pieces. */
export class Upsampler {
  constructor() {
    this.rest = new Float32Array(2 * HALF - 1);
    this.place = HALF - 1; // of the next frame, in samples of the rest
  }

  /** Frames that the samples so far suffice for, `step` samples apart. */
  push(samples, step) {
    const input = new Float32Array(this.rest.length + samples.length);
    input.set(this.rest);
    input.set(samples, this.rest.length);
    const frames = new Float32Array(Math.max(0, Math.ceil((input.length - HALF - this.place) / step)));
    let place = this.place;
    for (let i = 0; i < frames.length; i++, place += step) {
      const whole = Math.floor(place);
      const row = 2 * HALF * Math.floor((place - whole) * PHASES);
      let frame = 0;
      for (let tap = 0; tap < 2 * HALF; tap++) frame += KERNEL[row + tap] * input[whole - HALF + 1 + tap];
      frames[i] = frame;
    }
    const kept = Math.floor(place) - HALF + 1;
    this.rest = input.slice(kept);
    this.place = place - kept;
    return frames;
  }
}
