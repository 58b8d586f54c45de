// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The panel beside a hand that this page leads: what drives the motor, and how well.
import { byId, digits, setText } from "./elements.js";

const SATURATED = 0.98; // of the largest force, from which on the motor cannot do more

const parts = document.querySelectorAll(".touching");
let told = null; // controller whose error screen readers were told

/** Return what to do next, or how well the handle follows. */
function hint({ metrics, limits, nodes }) {
  const share = metrics.indistinguishable_percent;
  const loop = nodes.find(({ name, state }) => name === "loop" && state === "warning");
  if (loop) return loop.message; // time is left out
  if (metrics.rms_desired === undefined) return "Measuring…";
  if (metrics.nrmse_percent === undefined) return "Press the tool on the surface and stroke along it.";
  if (metrics.peak_force >= SATURATED * limits.force) return "The motor is at its largest force: stroke more gently.";
  if (share === undefined) return "Measuring…";
  return `A hand could not tell ${digits(share, 0)} % of it from the tool's.`;
}

/** Show the panel where the hand can be led. */
export function showTouch(state) {
  const { led, controller, metrics } = state;
  for (const part of parts) part.hidden = !led;
  if (!led) return;
  setText(byId("touch-hint"), hint(state));
  if (metrics.nrmse_percent === undefined || told === controller) return;
  told = controller; // once for each choice, not with each number
  setText(byId("touch-said"), `${controller}: error ${digits(metrics.nrmse_percent, 0)} percent`);
}
