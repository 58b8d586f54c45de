// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// How old is what the page shows, and whether it is known at all.
import { age } from "./clocks.js";
import { renew } from "./connection.js";
import { byId, setState, setText } from "./elements.js";

const OLD = 0.3; // s, age of the newest sample from which on it is a warning
const LOST = 500; // ms without a state from the scope after which what is shown counts as unknown
const WATCH = 100; // ms between two looks for that

let shownAt = performance.now(); // ms, when the last state was shown
let trouble = ""; // reason for a loss, if it is known

/** Whether no state came for too long, so that what is shown may be out of date. */
export let lost = false;

function showAge() {
  if (age.now === null) {
    setState(byId("link"), "waiting", "no signals");
    return;
  }
  const size = Math.abs(age.now);
  const when = age.now < -OLD ? "ahead of the scope's clock" : "old";
  const text = `data ${size.toFixed(size < 10 ? 2 : 0)} s ${when}`;
  setState(byId("link"), size < OLD ? "OK" : "warning", text);
}

/** Show what was known as unknown. */
function lose() {
  lost = true;
  document.body.classList.add("lost");
  setState(byId("stop-state"), "absent", "stop: unknown");
  setState(byId("arms"), "absent", "arms: unknown");
  setState(byId("recorder-state"), "absent", "unknown");
  for (const badge of document.querySelectorAll("#nodes .state")) setState(badge, "absent", "unknown");
  setText(byId("alarm"), byId("alarm").hidden ? "" : "Emergency stop when last heard of; now unknown.");
}

/** Show the age of what is seen, and its loss, whatever the scope or this tab was held up by. */
function watch() {
  const silence = performance.now() - shownAt;
  if (silence < LOST && !trouble) {
    if (!lost) showAge();
    return;
  }
  if (!lost) lose();
  const time = `no data for ${(silence / 1000).toFixed(1)} s`;
  setState(byId("link"), "error", trouble ? `${trouble}, ${time}` : time);
  renew(silence);
}

/** Note that a state has just been shown. */
export function found() {
  shownAt = performance.now();
  [lost, trouble] = [false, ""];
  document.body.classList.remove("lost");
  watch();
}

/** Show why nothing more comes. */
export function fail(reason) {
  trouble = reason;
  watch();
}

/** Look for a loss from now on. */
export function startWatching() {
  setInterval(watch, WATCH);
  document.addEventListener("visibilitychange", watch); // the interval is longer while hidden
}
