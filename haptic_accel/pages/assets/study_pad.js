// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The pad on which a participant leads the simulated hand. It shows the hand and what can be touched; the
// tool, which would tell of what is compared, is not sent to this page.
import { forgetColours } from "./axes.js";
import { want } from "./connection.js";
import { byId } from "./elements.js";
import { leadWithin, listenToPointers } from "./hand.js";
import { forgetPlaces, here } from "./places.js";
import { REQUEST_TIME, RETRY } from "./study_post.js";
import { drawSideView, view } from "./side_view.js";

const pad = byId("pad");
let drawing = null;

/** Show the pad or not; it leads the hand during a stimulus, and keeps what it holds after it. */
export async function showPad({ shown, led }) {
  view.classList.toggle("resting", !led);
  if (pad.hidden !== shown) return;
  pad.hidden = !shown;
  for (const name of ["sound", "scene"]) want(name, shown);
  if (shown) await readScene();
  else leadWithin(null);
}

/** Read what can be touched now, again until it has come or the pad is hidden. */
export async function readScene() {
  const answer = await fetch("/scene", { signal: AbortSignal.timeout(REQUEST_TIME) }).catch(() => null);
  if (!answer?.ok && !pad.hidden) setTimeout(readScene, RETRY);
  drawing = answer?.ok ? await answer.json() : drawing;
  leadWithin(pad.hidden ? null : drawing);
}

/** Take places by name, m. */
export const takePlaces = (places) => Object.assign(here, places);

function draw() {
  requestAnimationFrame(draw);
  if (!pad.hidden && drawing) drawSideView(drawing);
}

/** Let pointers and keys lead the hand. */
export function startPad() {
  forgetPlaces();
  view.tabIndex = 0;
  view.classList.add("led");
  listenToPointers();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", forgetColours);
  draw();
}
