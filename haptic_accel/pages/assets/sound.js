// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The handle's acceleration as sound: what arrives in frames is played without gaps.
// An AudioWorklet needs a secure context, which a phone that opens the page by http lacks; hence
// blocks are scheduled one after the other, each from the frame where the one before ends.
"use strict";

const hapticSound = (() => {
  const HALF = 4; // input samples on each side of the interpolation filter; its delay
  const PHASES = 1024; // positions between two input samples that the filter is tabulated at
  const SHARPNESS = 5; // of the Kaiser window: flat up to 0.3 of the rate, images of that 53 dB down
  const FULL_SCALE = 10; // m/s² at which full volume reaches the limiter
  const LATE = 128; // frames that the browser renders at a time: what begins sooner is too late
  const RESERVE = 0.008; // s that shall be left to play whenever samples arrive
  const MEMORY = 10; // s of which all but one shall be without underrun
  const BEND = 0.02; // largest change of speed, by which the reserve is corrected: a third of a semitone
  const HELD_UP = 0.04; // s of delay that only a page which draws too much needs; at rest it is 0.02
  const STALE = 0.25; // s by which samples may come late, or wait, before playing begins anew
  const GAP = 0.02; // s of lost samples across which a line is drawn, beyond which is silence
  const FADE = 0.005; // s in which sound begins, and ends where samples are late
  const SHOW = 500; // ms between two displays of the delay

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
  class Upsampler {
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

  /** Plays samples as they arrive, as soon as the unevenness of their arrival permits. */
  class Stream {
    constructor(context, output) {
      Object.assign(this, { context, output, underruns: 0, delay: 0 });
      this.reset();
    }

    /** Let what is scheduled fade away; the next samples begin anew. */
    reset() {
      this.gain?.gain.setTargetAtTime(0, this.context.currentTime, FADE / 3);
      this.gain = new GainNode(this.context);
      this.gain.connect(this.output);
      this.rate = null; // until samples come
    }

    /** Play samples of a rate in Hz, with stamps in s, after those that came before. */
    take(stamps, samples, rate) {
      const { currentTime: now, sampleRate } = this.context;
      const left = this.next / sampleRate - now; // s of what came before
      const lost = stamps[0] - this.newest;
      const other = Math.abs(rate / this.rate - 1) > BEND; // less is a better estimate
      if (other || !(Math.abs(lost) < STALE) || Math.abs(left) > STALE) {
        this.begin(now, stamps.at(-1) - GAP);
      } else {
        if (lost > GAP) this.skip(lost - 1 / rate);
        this.follow(now, this.next / sampleRate - now);
      }
      this.rate = rate;
      const step = (this.speed * rate) / sampleRate;
      const frames = this.upsampler.push(this.evened(stamps, samples), step);
      this.shift -= ((this.speed - 1) * frames.length) / sampleRate;
      if (frames.length) this.schedule(frames);
      this.delay = this.next / sampleRate - now + HALF / rate;
    }

    /** Begin anew after a time: of a backlog, only the end is played. */
    begin(now, newest) {
      this.reset();
      Object.assign(this, { newest, sample: 0, upsampler: new Upsampler() });
      Object.assign(this, { lowest: [], shift: 0, speed: 1 });
      this.pause(now);
    }

    /** Be silent for as long as no samples were there. */
    skip(seconds) {
      this.newest += seconds;
      this.next += Math.round(seconds * this.context.sampleRate);
      this.last = null;
    }

    /** Choose the speed at which the reserve comes back to what it should be. */
    follow(now, left) {
      if (left < LATE / this.context.sampleRate) {
        this.underruns++;
        this.shift -= left;
        left = this.pause(now);
        this.shift += left;
      }
      const excess = this.remember(now, left) - RESERVE;
      this.speed = 1 + Math.min(BEND, Math.max(-BEND, excess));
    }

    /** Let the next frame wait for the reserve; return for how long exactly, s. */
    pause(now) {
      const { sampleRate } = this.context;
      this.last = null;
      this.next = Math.ceil((now + RESERVE) * sampleRate);
      return this.next / sampleRate - now;
    }

    /** Note what is left to play when samples come; return the least that is usual. */
    remember(now, left) {
      // Kept as if what was inserted or skipped since had always been.
      const second = Math.floor(now);
      if (this.lowest[0]?.second !== second) this.lowest.unshift({ second, left: Infinity });
      this.lowest[0].left = Math.min(this.lowest[0].left, left - this.shift);
      this.lowest = this.lowest.filter((one) => one.second > second - MEMORY);
      const [least, next] = this.lowest.map((one) => one.left).sort((a, b) => a - b);
      return (next ?? least) + this.shift; // one bad second is none to wait for
    }

    /** Samples one period apart: where some were lost, a straight line. */
    evened(stamps, samples) {
      const even = [];
      samples.forEach((sample, index) => {
        const steps = Math.round((stamps[index] - this.newest) * this.rate);
        for (let k = 1; k <= steps; k++) even.push(this.sample + ((sample - this.sample) * k) / steps);
        if (steps < 1) return;
        this.newest = stamps[index];
        this.sample = sample;
      });
      return even;
    }

    /** Play frames next, and after them a fall to zero that is heard only if no more come in time. */
    schedule(frames) {
      const { context, last, next } = this;
      const fade = Math.round(FADE * context.sampleRate);
      const buffer = context.createBuffer(1, frames.length + fade, context.sampleRate);
      const played = buffer.getChannelData(0);
      played.set(frames);
      const end = frames.at(-1);
      for (let i = 0; i < fade; i++) played[frames.length + i] = end * (1 - (i + 1) / fade);
      if (!last) for (let i = 0; i < Math.min(fade, frames.length); i++) played[i] *= i / fade;
      const time = next / context.sampleRate;
      last?.stop(time);
      this.last = new AudioBufferSourceNode(context, { buffer });
      this.last.connect(this.gain);
      this.last.start(time);
      this.next += frames.length;
    }
  }

  const byId = (id) => document.getElementById(id);
  const on = byId("sound-on");
  const mute = byId("sound-mute");
  const volume = byId("sound-volume");
  const pressed = (button) => button.getAttribute("aria-pressed") === "true";
  const press = (button, state) => button.setAttribute("aria-pressed", String(state));
  let [context, output, stream] = [null, null, null];
  let ask = () => {}; // tells the server what this page needs
  let chosen = "actual";

  /** Volume, then a limiter that bends where a loudspeaker would clip. */
  function open() {
    context = new AudioContext({ latencyHint: 0 }); // the least that the device can do
    output = new GainNode(context, { gain: 0 });
    const curve = Float32Array.from({ length: 4097 }, (_, i) => Math.tanh(4 * (i / 2048 - 1)));
    output.connect(new WaveShaperNode(context, { curve })).connect(context.destination);
    stream = new Stream(context, output);
    setVolume();
    setInterval(show, SHOW);
  }

  function setVolume() {
    // The limiter's curve spans four times the full scale.
    const gain = pressed(mute) ? 0 : (volume.value / 100) ** 2 / (4 * FULL_SCALE);
    output?.gain.setTargetAtTime(gain, context.currentTime, FADE);
  }

  function show() {
    const ms = (seconds) => `${Math.round(1e3 * seconds)} ms`;
    const played = `buffer ${ms(stream.delay)}, output ${ms(context.outputLatency || context.baseLatency)}`;
    const text = stream.rate ? `delay: ${played}; underruns: ${stream.underruns}` : "no samples yet";
    byId("sound-delay").textContent = pressed(on) ? text : "off";
  }

  async function turn(state) {
    press(on, state);
    if (state && !context) open();
    stream.reset();
    ask();
    await (state ? context.resume() : context.suspend());
    show();
  }

  on.addEventListener("click", () => turn(!pressed(on)));
  mute.addEventListener("click", () => {
    press(mute, !pressed(mute));
    setVolume();
  });
  volume.addEventListener("input", setVolume);
  for (const button of document.querySelectorAll("[data-sound]")) {
    button.addEventListener("click", () => {
      chosen = button.dataset.sound;
      for (const one of document.querySelectorAll("[data-sound]")) press(one, one === button);
      stream?.reset();
    });
  }

  return {
    /** Samples of a signal: stamps in s after an origin, values in m/s², rate in Hz if known. */
    take(name, origin, offsets, values, rate) {
      if (name !== chosen || !rate || !values.length || context?.state !== "running") return;
      stream.take(Float64Array.from(offsets, (offset) => origin + offset), values, rate);
    },
    start: (given) => (ask = given),
    Stream,
    get on() {
      return pressed(on);
    },
    get heldUp() {
      return pressed(on) && stream.delay > HELD_UP;
    },
    get context() {
      return context;
    },
    get output() {
      return output;
    },
    get stream() {
      return stream;
    },
  };
})();
