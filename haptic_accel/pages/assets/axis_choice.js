// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The axis of the rig whose signals are shown: a choice where the rig has several.
import { want } from "./connection.js";
import { byId, press } from "./elements.js";

const buttons = [...document.querySelectorAll("#axes [data-axis]")];
let shownAxis = null; // axis of the samples that came last

/** Note the axis of new samples; return whether it is another one than before. */
export function isOtherAxis(axis) {
  const other = shownAxis !== null && axis !== shownAxis;
  shownAxis = axis;
  for (const button of buttons) press(button, button.dataset.axis === axis);
  return other;
}

/** Offer the axes that the rig has. */
export function showAxes(axes) {
  byId("axes").hidden = axes.length < 2;
  for (const button of buttons) button.hidden = !axes.includes(button.dataset.axis);
}

for (const button of buttons) {
  button.addEventListener("click", () => {
    for (const one of buttons) want(`axis_${one.dataset.axis}`, one === button);
  });
}
