// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Elements of a page, and how numbers are written into them.

/** Return the element of an id, null if the page has none. */
export const byId = (id) => document.getElementById(id);

/** Give an element a text; one that it has already costs no layout. */
export function setText(element, text) {
  if (element && element.textContent !== text) element.textContent = text;
}

/** Give a chip or a badge, if the page has it, a text, and the state that its colour shows. */
export function setState(element, state, text) {
  if (!element) return;
  if (element.dataset.state !== state) element.dataset.state = state;
  setText(element, text);
}

/** Return true if a button is pressed. */
export const isPressed = (button) => button.getAttribute("aria-pressed") === "true";

/** Show a button as pressed or not, and tell screen readers. */
export function press(button, pressed) {
  const value = String(pressed);
  if (button.getAttribute("aria-pressed") !== value) button.setAttribute("aria-pressed", value);
}

/**
 * Return a number as text, a dash if it is unknown.
 *
 * @param {?number} value
 * @param {number} places - digits after the decimal point
 * @param {number} [factor] - from the value's unit to the one that is shown
 * @returns {string}
 */
export const digits = (value, places, factor = 1) =>
  Number.isFinite(value) ? (factor * value).toFixed(places) : "–";
