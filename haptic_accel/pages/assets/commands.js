// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Commands to the graph, the buttons that give them, and the line that tells what came of it.
import { byId, isPressed, press, setState, setText } from "./elements.js";

const SAID = 10000; // ms for which a message stays visible
const COMMAND_TIME = 4000; // ms after which a command has failed

/** Whether this page may give commands. */
export const control = document.body.dataset.control === "true";
/** Whether there is a graph, with nodes, recorder and stop. */
export const graph = document.body.dataset.graph === "true";
let hiding = 0;

/** Show a message: "waiting" until the next, another kind for a while. */
export function tell(text, kind) {
  const message = byId("message");
  message.hidden = false;
  setState(message, kind, text);
  clearTimeout(hiding);
  if (kind !== "waiting") hiding = setTimeout(() => (message.hidden = true), SAID);
}

/** Give a command, tell what came of it, and return whether it was carried out. */
export async function command(action, value) {
  try {
    const answer = await fetch("/command", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ action, value }),
      signal: AbortSignal.timeout(COMMAND_TIME),
    });
    const { message } = await answer.json();
    if (message) tell(message, answer.ok ? "OK" : "error");
    return answer.ok;
  } catch {
    tell(`${action}: the scope does not answer`, "error");
    return false;
  }
}

/** Show which value of an action the graph has; a value that no button has as a text. */
export function showChoice(action, value) {
  const output = byId(action);
  const buttons = [...document.querySelectorAll(`[data-action=${action}]`)];
  for (const button of buttons) press(button, button.dataset.value === String(value));
  setText(output, value ?? "unknown");
  if (output && control) output.classList.toggle("hidden", buttons.some(isPressed));
}

/** Let the buttons give their commands. */
export function listenToChoices() {
  for (const button of document.querySelectorAll("[data-action]")) {
    button.addEventListener("click", async () => {
      const { action, value } = button.dataset;
      button.setAttribute("aria-busy", "true");
      await command(action, action === "engage" ? value === "true" : value);
      button.removeAttribute("aria-busy");
    });
  }
}
