// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Plays samples that come in pieces without gaps. An AudioWorklet needs a secure context, which a phone
// that opens the page by http lacks; hence blocks are scheduled one after the other, each from the
// frame where the one before ends.
import { HALF, Upsampler } from "./upsampler.js";

const LATE = 128; // frames that the browser renders at a time: what begins sooner is too late
const RESERVE = 0.008; // s that shall be left to play whenever samples arrive
const MEMORY = 10; // s of which all but one shall be without underrun
const BEND = 0.02; // largest change of speed, by which the reserve is corrected: a third of a semitone
const STALE = 0.25; // s by which samples may come late, or wait, before playing begins again
const BRIDGED = 0.02; // s of lost samples across which a line is drawn, beyond which is silence

/** Time in which sound begins, and ends where samples are late, s. */
export const FADE = 0.005;

/** Plays samples as they arrive, as soon as the unevenness of their arrival permits. */
export class Stream {
  constructor(context, output) {
    Object.assign(this, { context, output, underruns: 0, delay: 0 });
    this.reset();
  }

  /** Let what is scheduled fade away; the next samples begin again. */
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
      this.begin(now, stamps.at(-1) - BRIDGED);
    } else {
      if (lost > BRIDGED) this.skip(lost - 1 / rate);
      this.follow(now, this.next / sampleRate - now);
    }
    this.rate = rate;
    const step = (this.speed * rate) / sampleRate;
    const frames = this.upsampler.push(this.evened(stamps, samples), step);
    this.shift -= ((this.speed - 1) * frames.length) / sampleRate;
    if (frames.length) this.schedule(frames);
    this.delay = this.next / sampleRate - now + HALF / rate;
  }

  /** Begin again after a time: of a backlog, only the end is played. */
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
