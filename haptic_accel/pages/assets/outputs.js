// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The outputs of the computer by name, and the channels of one that has a game controller's grips.
import { tell } from "./commands.js";
import { byId, setText } from "./elements.js";

const UNNAMED = ["default", "communications"]; // identifiers of the system's own choices
const LOOK = 500; // ms between two looks at the outputs: Chromium may tell of a change only when asked
const LEAST = 4; // channels of an output with grips: the first two are a loudspeaker's

const names = byId("sound-output");
const channels = byId("sound-channels");
const ask = byId("sound-outputs");
const note = byId("sound-output-note");
let whenGone = () => {};

/** What is chosen: an output by its identifier, empty for the default, and its channels, from 0. */
export const chosenOutput = () => ({
  sinkId: names.value,
  channels: channels.hidden || !channels.value ? [] : channels.value.split(",").map(Number),
});

/** Offer the grips where an output has enough channels. */
export function offerChannels(count) {
  channels.hidden = count < LEAST;
  const few = names.value && channels.hidden;
  setText(note, few ? `${count} channels reach this output, of which grips are the third
    and fourth. See "Feel it in ten minutes" in the documentation: on Linux the sound server decides.` : "");
}

/** List the outputs that the browser names; tell if the chosen one is not among them any more. */
async function list() {
  const found = (await navigator.mediaDevices.enumerateDevices()).filter(
    ({ kind, label, deviceId }) => kind === "audiooutput" && label && !UNNAMED.includes(deviceId),
  );
  const ids = ["", ...found.map(({ deviceId }) => deviceId)];
  const { value, selectedOptions, options } = names;
  if (String(ids) === String(Array.from(options, (option) => option.value))) return found.length;
  const isGone = !ids.includes(value);
  const name = selectedOptions[0].textContent;
  names.replaceChildren(options[0], ...found.map((one) => new Option(one.label, one.deviceId)));
  names.value = isGone ? "" : value;
  if (isGone) {
    channels.value = "";
    whenGone();
    tell(`The output ${name} is gone, and sound is off: plug it in, and choose it again.`, "error");
  }
  return found.length;
}

/** Ask for the permission without which a browser names no output; nothing is recorded. */
async function askForNames() {
  let refusal = "";
  try {
    const recording = await navigator.mediaDevices.getUserMedia({ audio: true });
    for (const track of recording.getTracks()) track.stop();
  } catch (error) {
    refusal = error.name;
  }
  if (await list()) ask.hidden = true;
  else setText(note, `The browser names no output (${refusal || "none found"}): allow the microphone,
    of which nothing is recorded, or make the controller this computer's default output.`);
}

/** Look whether the chosen output is still there; without it, a browser plays on the default one. */
export function lookForOutput() {
  if (ask.hidden) list();
}

/**
 * Let outputs be chosen where the browser can.
 *
 * @param {function} changed - called when another output or channel is chosen
 * @param {function} gone - called when the chosen output is unplugged
 */
export function startOutputs(changed, gone) {
  names.addEventListener("change", () => {
    channels.value = "";
    changed();
  });
  channels.addEventListener("change", changed);
  if (!("setSinkId" in AudioContext.prototype)) {
    ask.hidden = true;
    setText(note, `To feel it in a game controller, open this page in Chromium, Chrome or Edge on the
      computer that serves it, or make the controller this computer's default output.`);
    return;
  }
  whenGone = gone;
  ask.addEventListener("click", askForNames);
  navigator.mediaDevices.addEventListener("devicechange", lookForOutput);
  setInterval(lookForOutput, LOOK);
}
