// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The loudspeaker of a page: vibration as sound, and noise that masks other sound.
import { FADE, Stream } from "./sound_stream.js";

const FULL_SCALE = 10; // m/s² at which full volume reaches the limiter
const NOISE_TIME = 4; // s after which the noise repeats: longer than what is remembered of noise

/**
 * Open the loudspeaker, silent: a volume, then a limiter that bends where a loudspeaker would clip.
 *
 * @param {object} [place]
 * @param {string} [place.sinkId] - output of the computer; empty for the default
 * @param {number[]} [place.channels] - channels that play, from 0, the others silent; empty for all
 */
export function openLoudspeaker({ sinkId = "", channels = [] } = {}) {
  const least = { latencyHint: 0 }; // the least that the device can do
  const context = new AudioContext(sinkId ? { ...least, sinkId } : least);
  const output = new GainNode(context, { gain: 0 });
  const curve = Float32Array.from({ length: 4097 }, (_, i) => Math.tanh(4 * (i / 2048 - 1)));
  output.connect(new WaveShaperNode(context, { curve })).connect(into(context.destination, channels));
  return { context, output, stream: new Stream(context, output) };
}

/** Return the node whose input plays on channels of a destination. */
function into(destination, channels) {
  if (!channels.length) return destination;
  destination.channelCount = destination.maxChannelCount;
  destination.channelCountMode = "explicit";
  destination.channelInterpretation = "discrete";
  const { context, channelCount } = destination;
  const one = new GainNode(context, { channelCount: 1, channelCountMode: "explicit" });
  const merger = new ChannelMergerNode(context, { numberOfInputs: channelCount });
  for (const channel of channels) one.connect(merger, 0, channel);
  merger.connect(destination);
  return one;
}

/** Fade to a volume from 0 to 1, by a factor of e in each given time, s. */
export function setVolume({ context, output }, volume, time = FADE) {
  // The limiter's curve spans four times the full scale.
  output.gain.setTargetAtTime(volume ** 2 / (4 * FULL_SCALE), context.currentTime, time);
}

/**
 * Prepare pink noise: of all sound, it masks the most of what coils give from 20 to 1000 Hz.
 *
 * @param {AudioContext} context
 * @param {number} level - root mean square, dB of full scale
 * @returns {GainNode} silent until its gain is 1
 */
export function pinkNoise(context, level) {
  const { sampleRate } = context;
  const buffer = context.createBuffer(1, NOISE_TIME * sampleRate, sampleRate);
  const samples = buffer.getChannelData(0);
  let [a, b, c] = [0, 0, 0];
  for (let i = 0; i < samples.length; i++) {
    // Poles and weights: Kellet, "economy" filter of white to pink noise, within 0.5 dB from 10 Hz on.
    const white = 2 * Math.random() - 1;
    a = 0.99765 * a + 0.099046 * white;
    b = 0.963 * b + 0.2965164 * white;
    c = 0.57 * c + 1.0526913 * white;
    samples[i] = a + b + c + 0.1848 * white;
  }
  const power = samples.reduce((sum, sample) => sum + sample * sample, 0) / samples.length;
  const scale = 10 ** (level / 20) / Math.sqrt(power);
  samples.forEach((sample, i) => (samples[i] = scale * sample));
  const played = new AudioBufferSourceNode(context, { buffer, loop: true });
  const gain = new GainNode(context, { gain: 0 });
  played.connect(gain).connect(context.destination);
  played.start();
  return gain;
}
