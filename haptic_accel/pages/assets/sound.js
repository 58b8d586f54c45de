// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The handle's acceleration as sound: the card's controls, and the loudspeaker behind them.
import { want } from "./connection.js";
import { byId, isPressed, press } from "./elements.js";
import { openLoudspeaker, setVolume } from "./loudspeaker.js";
import { chosenOutput, lookForOutput, offerChannels, startOutputs } from "./outputs.js";
import { Stream } from "./sound_stream.js";

const HELD_UP = 0.04; // s of delay that only a page which draws too much needs; at rest it is 0.02
const STARTED = 0.1; // s of a context's time until its device runs: before, it stands still for up to 0.5 s
const SHOW = 500; // ms between two displays of the delay
const LOW = 30; // volume at which coils begin, %
const RISE = 0.7; // s in which coils come to 63 % of their loudness, and in three times that to 95 %

const listen = byId("sound-on");
const mute = byId("sound-mute");
const volume = byId("sound-volume");
const choices = document.querySelectorAll("[data-sound]");
let played = "actual";

/** What is played, if sound was ever on. */
export const sound = {
  Stream,
  context: null,
  output: null,
  stream: null,
  from: 0, // time of the context from which on it plays, s

  /** Play samples of a signal: stamps in s after an origin, values in m/s², rate in Hz if known. */
  take(name, origin, offsets, values, rate) {
    if (name !== played || !rate || !values.length || sound.context?.state !== "running") return;
    if (sound.context.currentTime < sound.from) return; // what waits now would wait for seconds
    sound.stream.take(Float64Array.from(offsets, (offset) => origin + offset), values, rate);
  },

  /** Whether the page draws so much that sound comes late. */
  get heldUp() {
    return isPressed(listen) && sound.stream.delay > HELD_UP;
  },

  /** Play from now on. */
  turnOn: () => turn(true),

  /** Let the card's controls act. */
  start() {
    listen.addEventListener("click", () => turn(!isPressed(listen)));
    mute.addEventListener("click", () => {
      press(mute, !isPressed(mute));
      follow();
    });
    volume.addEventListener("input", () => follow());
    setInterval(show, SHOW);
    startOutputs(reopen, () => {
      press(listen, false);
      reopen();
    });
    for (const button of choices) {
      button.addEventListener("click", () => {
        played = button.dataset.sound;
        for (const one of choices) press(one, one === button);
        sound.stream?.reset();
      });
    }
  },
};

function open() {
  const place = chosenOutput();
  Object.assign(sound, openLoudspeaker(place));
  sound.context.addEventListener("error", lookForOutput);
  offerChannels(sound.context.destination.maxChannelCount);
  sound.coils = place.channels.length > 0;
  if (sound.coils) volume.value = Math.min(volume.value, LOW);
  follow();
}

/** Play on another output or other channels from now on, or when sound is turned on. */
async function reopen() {
  await sound.context?.close(); // first, so that never two play
  open();
  await turn(isPressed(listen));
}

/** Follow the card's volume; on coils that begin, from silence on. */
function follow(begins = false) {
  const { context, output, coils } = sound;
  if (!output) return;
  if (begins && coils) output.gain.cancelScheduledValues(0).setValueAtTime(0, context.currentTime);
  setVolume(sound, isPressed(mute) ? 0 : volume.value / 100, begins && coils ? RISE : undefined);
}

function show() {
  if (!sound.context) return;
  const { context, stream } = sound;
  const ms = (seconds) => `${Math.round(1e3 * seconds)} ms`;
  const played = `buffer ${ms(stream.delay)}, output ${ms(context.outputLatency || context.baseLatency)}`;
  const text = stream.rate ? `delay: ${played}; underruns: ${stream.underruns}` : "no samples yet";
  byId("sound-delay").textContent = isPressed(listen) ? text : "off";
}

async function turn(state) {
  press(listen, state);
  if (state && !sound.context) open();
  sound.stream.reset();
  if (state) follow(true);
  sound.from = sound.context.currentTime + STARTED;
  want("sound", state);
  await (state ? sound.context.resume() : sound.context.suspend());
  show();
}
