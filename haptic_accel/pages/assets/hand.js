// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The pointer that leads the simulated hand: mouse, pen, finger or arrow keys in the side view.
import { send } from "./connection.js";
import { clamp, counters, here, isKnown } from "./places.js";
import { pointAt, view } from "./side_view.js";

const PRESSED = 0.01; // m by which the full pressure of a pen lowers the hand
const KEY_STEP = 0.002; // m that an arrow key moves the hand
const KEY_TIME = 200; // ms for which a key leads the hand, so that it arrives
const KEYS = "keys"; // in place of a pointer's number
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

let ledScene = null; // in which the hand may be led; null if it may not
let ending = 0; // timer that ends the lead of keys
let grip = null; // the pointer that leads, and where the hand is to be

/** Let the hand be led within a drawing of the scene, or with null not at all. */
export function leadWithin(given) {
  ledScene = given;
}

/** Return true while a pointer leads the hand. */
export const isGripped = () => grip !== null;

const mayBegin = () => ledScene && !grip && isKnown(here.handle);

const reached = (place) => place.map((value, axis) => clamp(value, ledScene.view[axis]));

/** Where a pointer wants the hand, m in the master's base frame: its ring at the pointer. */
function pointed(event) {
  const [x, z] = pointAt(ledScene, event).map((value, axis) => value - ledScene.offset[axis]);
  return reached([x, z - (event.pointerType === "pen" ? PRESSED * event.pressure : 0)]);
}

function grab(event) {
  if (!mayBegin() || event.button) return;
  view.setPointerCapture(event.pointerId);
  grip = { id: event.pointerId, point: pointed(event) };
  lead();
}

/** Send the point for each picture, also while the pointer rests: so it is known to lead. */
function lead() {
  if (!grip) return;
  sendPoint(grip.point);
  requestAnimationFrame(lead);
}

function sendPoint(point) {
  send({ point });
  counters.points++;
}

/** Let the hand go. */
export function letGo() {
  if (grip) send({ point: null });
  grip = null;
}

function step(event) {
  const direction = ARROWS[event.key];
  const goesOn = grip?.id === KEYS;
  if (!direction || !(goesOn || mayBegin())) return;
  event.preventDefault();
  // From where the last key leads to: the hand follows later.
  const from = goesOn ? grip.point : here.handle;
  grip = { id: KEYS, point: reached(from.map((value, axis) => value + KEY_STEP * direction[axis])) };
  if (!goesOn) lead();
  clearTimeout(ending);
  ending = setTimeout(() => grip?.id === KEYS && letGo(), KEY_TIME);
}

/** Let pointers and keys in the side view lead the hand. */
export function listenToPointers() {
  view.addEventListener("pointerdown", grab);
  view.addEventListener("pointermove", (event) => {
    if (grip?.id === event.pointerId) grip.point = pointed(event);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    view.addEventListener(end, (event) => grip?.id === event.pointerId && letGo());
  }
  view.addEventListener("keydown", step);
}
