// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The page of a participant: takes the screens of a session, and gives the answers.
import { connect, renew } from "./connection.js";
import { byId, setText } from "./elements.js";
import { decode } from "./frames.js";
import { letGo } from "./hand.js";
import { OWN, post, postOnce } from "./study_post.js";
import { readScene, showPad, startPad, takePlaces } from "./study_pad.js";
import { askAgain, showScreen, startScreen, texts } from "./study_screen.js";
import { beginSound, isAudible, play, sound, takeSamples } from "./study_sound.js";

const LOST = 2000; // ms without a state after which the connection counts as lost
const WATCH = 250; // ms between two looks for that, and between two signs that a stimulus is seen
const TRIAL = new Set(["ready", "stimulus", "question", "feedback", "wait"]);

let state = null; // as it came last
let shownAt = performance.now(); // ms, when it came
let trouble = false; // the connection was closed
let opened = false; // the session knows of this page

/** Screens of the page itself: while another page is the participant's, and before this one may give sound. */
const own = (id, text, answer) => ({ id, kind: id, text, answers: [answer], seconds: 0, elapsed: 0 });
const OTHER = own("other", "other_page", "use_here");
const ALLOW = own("allow", "title", "begin");
const ALLOW_NOISE = own("allow", "title", "noise_test");
const TEST = own("test", "noise_on", "begin");
let tested = false; // the participant has heard the noise

function current() {
  if (state.page !== OWN) return OTHER;
  const isNoisy = state.noise !== null;
  if ((isNoisy || state.led) && !isAudible()) return isNoisy ? ALLOW_NOISE : ALLOW;
  return isNoisy && !tested ? TEST : state.screen;
}

async function open() {
  opened = false;
  await post("open", [OWN]);
  opened = true;
}

async function give(id, value, seconds) {
  if (id === OTHER.id) await open();
  else if (id === ALLOW.id) await beginSound(state.noise);
  else if (id === TEST.id) tested = true;
  else if (!(await post("answer", [id, value, seconds]))) askAgain(id);
  show();
}

function show() {
  if (!opened || !state) return;
  const screen = current();
  const { kind } = screen;
  const trial = TRIAL.has(kind);
  const isNew = showScreen(screen, screen.elapsed);
  byId("progress").value = state.screen.progress;
  byId("stop").hidden = kind === "end" || kind === "stopped";
  byId("noise").hidden = !(trial && sound.noise && isAudible());
  play({ vibration: kind === "stimulus", noise: trial || kind === "test" });
  showPad({ shown: trial && state.led, led: kind === "stimulus" });
  if (!isNew) return;
  if (kind === "stimulus" && state.led) {
    readScene();
    byId("scene").focus();
  }
  requestAnimationFrame(sign);
}

/** Tell that the stimulus is seen: its screen is shown, and its noise plays. */
function sign() {
  if (!state || !opened || trouble || document.hidden || current().kind !== "stimulus") return;
  postOnce("seen", [state.screen.id, state.noise]);
}

function takeState(received) {
  if (received.refused) {
    letGo();
    return;
  }
  if (state && state.version !== received.version) {
    location.reload(); // another session
    return;
  }
  [state, shownAt, trouble] = [received, performance.now(), false];
  if (opened && !state.page) open(); // a session that goes on
  show();
  watch();
}

function takeFrame(buffer) {
  const frame = decode(buffer);
  if (frame.kind === "places") takePlaces({ handle: frame.places.handle });
  if (frame.kind !== "samples") return;
  const actual = frame.signals.find(({ name }) => name === "actual");
  takeSamples(frame.origin, actual, state?.metrics.rate);
}

/** Show whether the session is reached. */
function watch() {
  const silence = performance.now() - shownAt;
  const lost = trouble || silence > LOST;
  const over = ["end", "stopped"].includes(state?.screen.kind);
  const alarm = byId("alarm");
  alarm.hidden = !lost || over;
  setText(alarm, alarm.hidden ? "" : texts.lost_connection);
  if (!lost) return;
  play({ vibration: false, noise: false });
  renew(silence);
}

startScreen(give);
startPad();
setInterval(() => {
  watch();
  sign();
}, WATCH);
open();
connect({
  opened() {},
  frame: takeFrame,
  state: takeState,
  failed() {
    trouble = true;
    watch();
  },
});

// What is played, for tests and debugging.
window.hapticSound = sound;
