// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The signals that the user chose to see, which the browser remembers.
import { want } from "./connection.js";
import { byId } from "./elements.js";
import { ON_DEMAND, TRACES } from "./traces.js";

const REMEMBERED = "haptic_accel scope: signals"; // name under which the browser keeps the choice

/** Names of the signals that were shown last; null if the browser keeps nothing. */
function remembered() {
  try {
    return localStorage.getItem(REMEMBERED)?.split(" ");
  } catch {
    return null;
  }
}

/** Names of the signals that are shown. */
export const chosen = new Set(remembered() ?? ["desired", "actual"]);

function choose(name, wanted) {
  if (wanted) chosen.add(name);
  else chosen.delete(name);
  if (ON_DEMAND.includes(name)) want(name, wanted);
  try {
    localStorage.setItem(REMEMBERED, [...chosen].join(" "));
  } catch {
    // the choice lasts as long as the page
  }
}

/** Let the user choose, and call a function after each change. */
export function listenToSignals(changed) {
  for (const name of ON_DEMAND) want(name, chosen.has(name));
  for (const name of TRACES) {
    const box = byId(`show-${name}`);
    box.checked = chosen.has(name);
    box.style.accentColor = `var(--${name})`;
    box.addEventListener("change", () => {
      choose(name, box.checked);
      changed();
    });
  }
}
