// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The cards of scene and contact: side view, speed-force plane, and the hand that a pointer may lead.
import { want } from "./connection.js";
import { byId } from "./elements.js";
import { isGripped, leadWithin, letGo, listenToPointers } from "./hand.js";
import { counters, forgetPlaces, here, isKnown } from "./places.js";
import { drawSideView, view } from "./side_view.js";
import { drawPlane, followContact, forgetContact, makePlane, redrawPlane } from "./speed_force_plane.js";

const REQUEST_TIME = 4000; // ms after which the scene is asked for again

const cards = [byId("scene-card"), byId("contact-card")];
const inSight = new Set(); // of these cards
let drawing = null; // as the scope serves it
let name = null; // of the scene that is drawn
let led = false;

function forgetScene() {
  forgetPlaces();
  forgetContact();
}

/** The scene; `counters` and `here` are for tests and debugging. */
export const scene = {
  counters,
  here,
  forget: forgetScene,
  letGo,
  redraw: redrawPlane,
  isGripped,

  /** Take places by name, in m, m/s and N. */
  take(places) {
    Object.assign(here, places);
    counters.places++;
    followContact(drawing);
  },

  draw() {
    byId("scene-waiting").hidden = isKnown(here.tool);
    if (!inSight.size || !drawing) return;
    drawSideView(drawing);
    drawPlane(drawing);
    counters.drawn++;
  },

  /** Follow the graph's state. */
  async show(state) {
    if (led !== Boolean(state.led)) {
      led = !led;
      byId("page").prepend(led ? cards[0] : byId("time-card")); // first for eyes and keys
    }
    leadWithin(led ? drawing : null);
    for (const part of [byId("page"), view]) part.classList.toggle("led", led);
    view.tabIndex = led ? 0 : -1;
    const shown = state.scene ?? (led ? "" : null); // a hand can be led wherever the tool is
    if (shown === name) return;
    name = shown;
    for (const card of cards) card.hidden = name === null;
    if (name === null) return;
    // The arrow keys lead the hand at once, unless the user has the keyboard somewhere else.
    if (led && document.activeElement === document.body) view.focus({ preventScroll: true });
    makePlane();
    try {
      const answer = await fetch("/scene", { signal: AbortSignal.timeout(REQUEST_TIME) });
      drawing = answer.ok ? await answer.json() : null;
      leadWithin(led ? drawing : null);
    } catch {
      name = null; // asked again with the next state
    }
  },

  /** Ask for places while they are in sight, and let pointers lead the hand. */
  start() {
    forgetScene();
    listenToPointers();
    const observer = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        if (isIntersecting) inSight.add(target);
        else inSight.delete(target);
      }
      if (!inSight.size) forgetScene(); // places come only while they are seen
      want("scene", inSight.size > 0);
    });
    for (const card of cards) observer.observe(card);
  },
};
