// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The page of a bring-up: shows its steps, requests and lines, and gives the answers.
import { forgetColours } from "./axes.js";
import { command } from "./commands.js";
import { connect, renew } from "./connection.js";
import { byId, setState, setText } from "./elements.js";
import { showSignal, signalPlot } from "./signal_plot.js";

const LOST = 2000; // ms without a state after which the connection counts as lost
const WATCH = 250; // ms between two looks for that
const READING = 500; // ms for which a new request takes no answer: the longest double click
const CHIPS = { done: "OK", now: "waiting", waiting: "absent" };
const GONE =
  "No connection to the bring-up. If it has ended in the terminal, the same command there goes on with the unfinished step.";

const [form, field, skip] = [byId("answering"), byId("answer"), byId("skip")];
let state = null; // as it came last
let shownAt = performance.now(); // ms, when it came
let trouble = false; // the connection was closed
let request = { number: 0, at: 0, answered: false, focused: false }; // that the form belongs to

function showSteps(steps) {
  const list = byId("steps");
  while (list.children.length < steps.length) {
    const item = list.appendChild(document.createElement("li"));
    for (const part of ["name", "chip", "note"]) {
      item.appendChild(document.createElement("span")).className = part;
    }
  }
  steps.forEach(({ name, purpose, state: at }, i) => {
    const item = list.children[i];
    const [title, chip, note] = item.children;
    setText(title, name);
    setState(chip, CHIPS[at], at);
    setText(note, purpose);
    if (at === "now") item.setAttribute("aria-current", "step");
    else item.removeAttribute("aria-current");
  });
}

/** Show lines; those that are there already stay, so that only new ones are read out. */
function showLines(lines) {
  const box = byId("lines");
  const there = [...box.children];
  const goesOn = there.length <= lines.length && there.every((one, i) => one.textContent === lines[i].text);
  if (!goesOn) box.replaceChildren();
  for (const { kind, text } of lines.slice(box.children.length)) {
    const line = box.appendChild(document.createElement("p"));
    line.dataset.kind = kind;
    line.textContent = text;
    box.scrollTop = box.scrollHeight;
  }
}

function showRequest() {
  const { asks, ended, number, skip: offer } = state;
  if (asks && number !== request.number) {
    request = { number, at: performance.now(), answered: false, focused: false };
    field.value = "";
  }
  setText(byId("request"), state.request ?? (ended === null ? "Wait: the bring-up is measuring." : ended));
  form.hidden = !asks || request.answered;
  byId("field").hidden = ended !== null;
  setText(byId("continue"), ended === null ? "Continue" : "Close the bring-up");
  skip.hidden = offer === null;
  setText(skip, offer ?? "");
  const ready = performance.now() - request.at >= READING;
  for (const button of [byId("continue"), skip]) button.disabled = !ready;
  if (!form.hidden && !request.focused) focusOn(ended === null ? field : byId("continue"));
}

/** Show what the request is: something to do, or the end of all steps or of this run. */
function showTitle({ ended, steps }) {
  const done = steps.every(({ state: at }) => at === "done");
  const end = done ? "The rig is brought up" : "The bring-up has stopped";
  setText(byId("request-title"), ended === null ? "What to do now" : end);
}

/** Put the keyboard where the answer is given, unless the user has it somewhere else. */
function focusOn(target) {
  if (target.disabled) return;
  request.focused = true;
  if ([document.body, null].includes(document.activeElement)) target.focus();
}

async function answer(text) {
  const asked = request;
  asked.answered = true;
  form.hidden = true;
  asked.answered = await command("answer", `${asked.number}:${text}`);
}

function takeState(received) {
  if (received.refused) return;
  state = received;
  [shownAt, trouble] = [performance.now(), false];
  showSteps(state.steps);
  showLines(state.lines);
  showTitle(state);
  showRequest();
  showSignal(state.signal);
  watch();
}

/** Show whether the bring-up is reached. */
function watch() {
  const silence = performance.now() - shownAt;
  const lost = trouble || silence > LOST;
  const over = state !== null && state.ended !== null;
  const alarm = byId("alarm");
  alarm.hidden = !lost || over;
  setText(alarm, alarm.hidden ? "" : GONE);
  if (!lost) {
    if (state) setState(byId("link"), "OK", "connected");
    return;
  }
  setState(byId("link"), over ? "absent" : "error", over ? "closed" : "no connection");
  form.hidden = true;
  showSignal(null);
  renew(silence);
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  answer(field.value);
});
// A key that is held must not answer the requests that follow.
form.addEventListener("keydown", (event) => event.repeat && event.key === "Enter" && event.preventDefault());
skip.addEventListener("click", () => answer("s"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  forgetColours();
  signalPlot.redraw();
});
setInterval(watch, WATCH);
connect({
  opened() {},
  frame() {}, // there are no signals of a graph
  state: takeState,
  failed() {
    trouble = true;
    watch();
  },
});
