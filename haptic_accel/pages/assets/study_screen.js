// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// One screen of a session: its heading, text, answers and countdown, by mouse, finger or keys.
import { byId, press, setText } from "./elements.js";

const MOST_BUTTONS = 12; // answers beyond which there is a scale
const [FEW, SHORT] = [3, 3]; // answers, and characters of each, from which and up to which buttons are small
const LOADING = 1; // s that a page may take to show a screen: if it began longer ago, the page was loaded again
const LONG = 90; // characters beyond which a text is no heading
const DOUBLE = 500; // ms for which another press is part of a double click
const LOOK = 200; // ms between two looks at the countdown
const INTERVALS = { 1: "first", 2: "second", 3: "third" }; // words of answers that name an interval
const NEXT = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

export const texts = JSON.parse(document.body.dataset.texts);
const [box, group, rating, scale] = ["screen", "answers", "rating", "rate"].map(byId);
let screen = { id: null, answers: [] };
let screenShownAt = 0; // ms by the page's clock
let endsAt = 0; // ms, when the screen may be left
let pressedAt = -Infinity; // ms, when an answer was given last
let answered = false;
let isFirst = true; // of the session's screens on this page
let choose = () => {}; // what is done with an answer

/** Return a text of the session in the page's language, if it is one of its words. */
const translated = (text) => (Object.hasOwn(texts, text) ? texts[text] : text);

/** Return an answer with its label: a word, an interval, or the values of a condition. */
function labelled(value, _, values) {
  if (values.every((each) => each in INTERVALS)) return { value, label: texts[INTERVALS[value]] };
  return { value, label: translated(value.replaceAll(/\S+=/g, "")) };
}

const buttons = () => [...group.querySelectorAll("button")];
const isRated = () => screen.answers.length > MOST_BUTTONS;
const isNumber = ({ value }) => /^\d+$/.test(value);

/** Return the key of an answer: its own number or letter, else its place. */
function keyOf(answer, index) {
  if (/^[\dA-Za-z]$/.test(answer.value)) return answer.value;
  return screen.answers.some(isNumber) || index > 8 ? "" : String(index + 1);
}

function button(answer, index) {
  const made = document.createElement("button");
  const key = screen.answers.length > 1 ? keyOf(answer, index) : "";
  made.type = "button";
  if (key && key !== answer.label) made.appendChild(document.createElement("kbd")).textContent = key;
  made.append(answer.label);
  made.querySelector("kbd")?.setAttribute("aria-hidden", "true");
  if (key) made.setAttribute("aria-keyshortcuts", key);
  made.addEventListener("click", (event) => giveOnce(answer.value, event, made));
  return made;
}

/** Give an answer, unless there is one, or this press belongs to the one before. */
function giveOnce(value, { timeStamp }, pressed) {
  const [at, waits] = [performance.now(), performance.now() < endsAt];
  if (answered || waits || timeStamp < screenShownAt || at - pressedAt < DOUBLE) return;
  [pressedAt, answered] = [at, true];
  if (pressed) press(pressed, true);
  lock();
  choose(screen.id, value, (timeStamp - screenShownAt) / 1000);
}

/** Take an answer again: the one given was refused. */
export function askAgain(id) {
  if (screen.id !== id) return;
  answered = false;
  for (const each of buttons()) each.removeAttribute("aria-pressed");
  lock();
}

function lock() {
  const waits = performance.now() < endsAt;
  for (const each of [...buttons(), byId("submit")]) each.disabled = waits;
  box.classList.toggle("answered", answered);
}

/** A heading of its own for each screen, so that screen readers read it when the focus comes. */
function showHeading(text) {
  const before = byId("heading");
  const heading = before.cloneNode();
  before.replaceWith(heading);
  setText(heading, text);
  return heading;
}

function showRating() {
  rating.hidden = !isRated();
  if (rating.hidden) return;
  scale.max = screen.answers.length - 1;
  scale.value = Math.round(scale.max / 2);
  delete scale.dataset.touched;
  setText(byId("rated"), "–");
  scale.setAttribute("aria-valuetext", "–");
  setText(byId("least"), screen.answers[0].label);
  setText(byId("most"), screen.answers.at(-1).label);
}

function rate() {
  const { label } = screen.answers[scale.value];
  scale.dataset.touched = "true"; // the middle is no answer before
  setText(byId("rated"), label);
  scale.setAttribute("aria-valuetext", label);
}

const submit = (event) => scale.dataset.touched && giveOnce(screen.answers[scale.value].value, event);

/** Begin the times of a screen: of answers by this page's clock, also if it was loaded meanwhile. */
function beginTimes({ answers, kind, seconds }, elapsed) {
  const waits = answers.length > 0 || kind === "break";
  const old = isFirst && answers.length > 0 && elapsed > LOADING;
  isFirst &&= elapsed === 0; // as it is in screens of the page itself
  endsAt = waits ? performance.now() + 1000 * Math.max(0, seconds - elapsed) : 0;
  screenShownAt = performance.now() - (old ? 1000 * elapsed : 0);
  if (!old) requestAnimationFrame(() => (screenShownAt = performance.now()));
}

/** Show what a screen says; return its heading. */
function showText({ kind, text, interval }) {
  const said = translated(text || kind);
  const stimulus = kind === "stimulus";
  const long = stimulus || said.length > LONG || said.includes("\n");
  setText(byId("text"), stimulus ? texts.feel_now : said);
  byId("text").hidden = !long;
  return showHeading(stimulus ? `${texts.interval} ${interval}` : long ? texts.title : said);
}

function showAnswers() {
  const { answers } = screen;
  showRating();
  group.replaceChildren(...(isRated() ? [] : answers.map(button)));
  const short = answers.every(({ label }) => label.length <= SHORT);
  group.classList.toggle("many", short && answers.length > FEW);
  byId("keys").hidden = answers.length < 2 || isRated();
}

/** Show a screen that began `elapsed` s ago, unless it is shown already; return whether it is new. */
export function showScreen(next, elapsed) {
  if (next.id === screen.id) return false;
  screen = { ...next, answers: next.answers.map(labelled) };
  answered = false;
  box.dataset.kind = screen.kind;
  beginTimes(screen, elapsed);
  const heading = showText(screen);
  showAnswers();
  countDown();
  heading.focus();
  return true;
}

/** Show the time that is left of a break, and let it be left at its end. */
function countDown() {
  const left = Math.max(0, endsAt - performance.now());
  byId("count").hidden = !left;
  setText(byId("left"), String(Math.ceil(left / 1000)));
  const opens = !left && buttons().some((each) => each.disabled);
  lock();
  if (opens) buttons()[0].focus();
}

function takeKey(event) {
  const { key, target } = event;
  if (event.repeat && !NEXT[key]) {
    event.preventDefault(); // a key that is held answers once
    return;
  }
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const all = buttons();
  const found = screen.answers.findIndex((answer, index) => keyOf(answer, index) === key.toUpperCase());
  if (target === scale) {
    if (key === "Enter") submit(event);
  } else if (found >= 0 && all[found]) {
    giveOnce(screen.answers[found].value, event, all[found]);
  } else if (NEXT[key] && target.id !== "scene" && all.length) {
    event.preventDefault();
    const at = all.indexOf(document.activeElement);
    const next = at < 0 ? (NEXT[key] > 0 ? 0 : -1) : (at + NEXT[key] + all.length) % all.length;
    all.at(next).focus();
  } else if (key === "Enter" && all.length === 1 && target.tagName !== "BUTTON") {
    giveOnce(screen.answers[0].value, event, all[0]);
  } else if (NEXT[key] && isRated() && target.id !== "scene") {
    scale.focus();
  }
}

/** Let presses and keys answer by `taken(id, value, seconds)`. */
export function startScreen(taken) {
  choose = taken;
  document.addEventListener("keydown", takeKey);
  scale.addEventListener("input", rate);
  byId("submit").addEventListener("click", submit);
  setInterval(countDown, LOOK);
}
