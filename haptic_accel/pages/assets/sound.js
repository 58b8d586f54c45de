// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The handle's acceleration as sound: the card's controls, and the loudspeaker behind them.
import { want } from "./connection.js";
import { byId, isPressed, press } from "./elements.js";
import { openLoudspeaker, setVolume } from "./loudspeaker.js";
import { Stream } from "./sound_stream.js";

const HELD_UP = 0.04; // s of delay that only a page which draws too much needs; at rest it is 0.02
const SHOW = 500; // ms between two displays of the delay

const on = byId("sound-on");
const mute = byId("sound-mute");
const volume = byId("sound-volume");
const choices = document.querySelectorAll("[data-sound]");
let chosen = "actual";

/** What is played, if sound was ever on. */
export const sound = {
  Stream,
  context: null,
  output: null,
  stream: null,

  /** Play samples of a signal: stamps in s after an origin, values in m/s², rate in Hz if known. */
  take(name, origin, offsets, values, rate) {
    if (name !== chosen || !rate || !values.length || sound.context?.state !== "running") return;
    sound.stream.take(Float64Array.from(offsets, (offset) => origin + offset), values, rate);
  },

  /** Whether the page draws so much that sound comes late. */
  get heldUp() {
    return isPressed(on) && sound.stream.delay > HELD_UP;
  },

  /** Play from now on. */
  turnOn: () => turn(true),

  /** Let the card's controls act. */
  start() {
    on.addEventListener("click", () => turn(!isPressed(on)));
    mute.addEventListener("click", () => {
      press(mute, !isPressed(mute));
      follow();
    });
    volume.addEventListener("input", follow);
    for (const button of choices) {
      button.addEventListener("click", () => {
        chosen = button.dataset.sound;
        for (const one of choices) press(one, one === button);
        sound.stream?.reset();
      });
    }
  },
};

function open() {
  Object.assign(sound, openLoudspeaker());
  follow();
  setInterval(show, SHOW);
}

/** Follow the card's volume. */
function follow() {
  if (sound.output) setVolume(sound, isPressed(mute) ? 0 : volume.value / 100);
}

function show() {
  const { context, stream } = sound;
  const ms = (seconds) => `${Math.round(1e3 * seconds)} ms`;
  const played = `buffer ${ms(stream.delay)}, output ${ms(context.outputLatency || context.baseLatency)}`;
  const text = stream.rate ? `delay: ${played}; underruns: ${stream.underruns}` : "no samples yet";
  byId("sound-delay").textContent = isPressed(on) ? text : "off";
}

async function turn(state) {
  press(on, state);
  if (state && !sound.context) open();
  sound.stream.reset();
  want("sound", state);
  await (state ? sound.context.resume() : sound.context.suspend());
  show();
}
