// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The connection to the scope: what is asked of it and what it sends, for as long as the page is open.
import { tell } from "./commands.js";

const RENEW = 5000; // ms without a state after which another connection is tried
const INTERNAL_ERROR = 1011; // WebSocket's code: the server failed
const FIRST_RETRY = 250; // ms
const LAST_RETRY = 2000; // ms

const onDemand = new Set();
let handling = {};
let socket = null;
let openedAt = -Infinity; // ms, when a connection was tried last
let retry = FIRST_RETRY;

/** Send a value as JSON; it is dropped while there is no connection. */
export function send(value) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(value));
}

/** Ask the scope for what it sends on demand only, by its name, or for it no more. */
export function want(name, yes) {
  if (yes) onDemand.add(name);
  else onDemand.delete(name);
  send([...onDemand]);
}

/**
 * Connect, and again whenever the connection is lost.
 *
 * @param {object} [handlers] - `opened()`, `frame(buffer)`, `state(object)` and `failed(reason)`; each
 *   is called for the newest connection only. Without them those given before are called.
 */
export function connect(handlers = handling) {
  handling = handlers;
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const opened = new WebSocket(`${scheme}://${location.host}/live`);
  socket = opened;
  openedAt = performance.now();
  opened.binaryType = "arraybuffer";
  // One that was given up says nothing more.
  const listen = (event, act) =>
    opened.addEventListener(event, (given) => socket === opened && act(given));
  listen("open", () => {
    handlers.opened();
    send([...onDemand]);
  });
  listen("message", ({ data }) => {
    if (typeof data !== "string") {
      handlers.frame(data);
      return;
    }
    try {
      handlers.state(JSON.parse(data));
      retry = FIRST_RETRY;
    } catch (fault) {
      handlers.failed("this page failed");
      console.error(fault);
    }
  });
  listen("close", ({ code }) => {
    handlers.failed(code === INTERNAL_ERROR ? "the scope failed, see its log" : "scope not reached");
    setTimeout(connect, retry);
    if (retry === LAST_RETRY) checkToken();
    retry = Math.min(2 * retry, LAST_RETRY);
  });
}

/** After a silence in ms, replace a connection that broke without a word: here it stays open for ever. */
export function renew(silence) {
  const waited = Math.min(silence, performance.now() - openedAt);
  if (waited <= RENEW || socket.readyState !== WebSocket.OPEN) return;
  const silent = socket;
  connect();
  silent.close();
}

/** A restarted scope may have another token; a socket does not report that. */
async function checkToken() {
  try {
    const answer = await fetch("/", { method: "HEAD" });
    if (answer.status === 403) tell("open the address that the scope printed last", "error");
  } catch {
    // not reachable, which is shown already
  }
}
