// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// What the participant hears: the handle's vibration during a stimulus, and noise during the trials.
import { openLoudspeaker, pinkNoise, setVolume } from "./loudspeaker.js";

const VOLUME = 0.7; // from 0 to 1, of the handle's vibration
const NOISE_FADE = 0.1; // s

/** What is played, once the participant has allowed it. */
export const sound = { context: null, output: null, stream: null, noise: null };

/** Whether the browser plays what it is given. */
export const isAudible = () => sound.context?.state === "running";

/** Begin, in answer to a press; with a level in dB of full scale there is noise. */
export async function beginSound(level) {
  if (!sound.context) {
    Object.assign(sound, openLoudspeaker());
    if (level !== null) sound.noise = pinkNoise(sound.context, level);
  }
  await sound.context.resume();
}

/** Play vibration and noise from now on, or not. */
export function play({ vibration, noise }) {
  if (!sound.context) return;
  setVolume(sound, vibration ? VOLUME : 0);
  sound.noise?.gain.setTargetAtTime(noise ? 1 : 0, sound.context.currentTime, NOISE_FADE);
}

/** Take samples of the handle's acceleration, m/s², at a rate in Hz. */
export function takeSamples(origin, { offsets, values }, rate) {
  if (!rate || !values.length || !isAudible()) return;
  sound.stream.take(Float64Array.from(offsets, (offset) => origin + offset), values, rate);
}
