// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The states of the graph's nodes, and what the recorder reports.
import { lost } from "./age_chip.js";
import { tell } from "./commands.js";
import { byId, setState, setText } from "./elements.js";

const HIDDEN_FACTS = new Set(["scheduling", "state"]);

/** Element of a kind with others inside. */
function element(kind, ...inside) {
  const made = document.createElement(kind);
  made.append(...inside);
  return made;
}

function nodeItem(name) {
  const item = element("li", ...["who", "state", "say"].map((kind) => {
    const part = element("span");
    part.className = kind;
    return part;
  }));
  item.dataset.node = name;
  return item;
}

/** Show the nodes' names, states and messages; tell it when a state turns bad. */
export function showNodes(rows) {
  const list = byId("nodes");
  for (const row of rows) {
    let item = list.querySelector(`[data-node="${CSS.escape(row.name)}"]`);
    if (!item) list.append((item = nodeItem(row.name)));
    const [who, badge, say] = item.children;
    const before = badge.dataset.state;
    setText(who, row.name);
    setState(badge, row.state, row.state);
    setText(say, row.message);
    // The emergency stop has its own display.
    const news = before && !lost && before !== row.state && row.state !== "OK";
    if (news && row.message !== "emergency stop") {
      tell(`${row.name}: ${row.message || row.state}`, row.state);
    }
  }
}

/** Name and value of a fact for display: bytes as a rounded size. */
function readable([name, value]) {
  const [, plain] = name.match(/^(.*) [[(]bytes[\])]$/) ?? [];
  if (!plain) return [name, value];
  const mega = Number(value) / 1e6;
  return [plain, mega < 1e3 ? `${mega.toFixed(1)} MB` : `${(mega / 1e3).toFixed(1)} GB`];
}

/** Show the recorder's state among those of the nodes, and its facts by name. */
export function showRecorder(rows, facts) {
  const row = rows.find(({ name }) => name === "recorder");
  const words = { OK: facts.state || "recording", absent: "not recording" };
  setState(byId("recorder-state"), row.state, words[row.state] || row.message || row.state);
  const shown = Object.entries(facts)
    .filter(([name]) => !HIDDEN_FACTS.has(name))
    .map(readable);
  const list = byId("recorder");
  const names = shown.map(([name]) => name).join("\n");
  if (list.dataset.names !== names) {
    list.dataset.names = names;
    list.replaceChildren(...shown.map(([name]) => element("div", element("dt", name), element("dd"))));
  }
  shown.forEach(([, value], index) => setText(list.children[index].lastChild, value));
}
