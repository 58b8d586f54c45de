// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// What the participant's page tells the session: each message until it is acknowledged.
export const REQUEST_TIME = 4000; // ms after which a request has failed
export const RETRY = 300; // ms between two attempts
const FAILED = 500; // HTTP status from which on the server may do better next time

/** Name of this page among those that are open. */
export const OWN = Math.random().toString(36).slice(2);

/** Send an action once; return the status of the answer, or `FAILED` without one. */
export async function postOnce(action, value) {
  try {
    const answer = await fetch("/command", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ action, value: JSON.stringify(value) }),
      signal: AbortSignal.timeout(REQUEST_TIME),
    });
    return answer.status;
  } catch {
    return FAILED;
  }
}

/** Send an action until it is acknowledged or refused; return whether it was acknowledged. */
export async function post(action, value) {
  for (;;) {
    const status = await postOnce(action, value);
    if (status < FAILED) return status < 400;
    await new Promise((resolve) => setTimeout(resolve, RETRY));
  }
}
