// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Where tool, handle and contact are.
import { PLACES } from "./frames.js";

/** Places by name: in m, m/s, m and N, each along x and z; NaN while unknown. */
export const here = {};

/** Counts of places received, points sent and pictures drawn, for tests and debugging. */
export const counters = { places: 0, points: 0, drawn: 0 };

/** Return true if a place is known. */
export const isKnown = ([x, z]) => Number.isFinite(x) && Number.isFinite(z);

/** Return the value within limits, in any unit, that is nearest to another. */
export const clamp = (value, [low, high]) => Math.min(high, Math.max(low, value));

/** Hold every place for unknown. */
export function forgetPlaces() {
  for (const place of PLACES) here[place] = [NaN, NaN];
}
