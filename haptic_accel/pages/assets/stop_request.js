// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The request for a stop: sent again until it is confirmed, also after a reload. Inline in the page's head, so
// that it needs no other load and runs before the button is shown. Its element states command and words.
window.hapticStop = (() => {
  const REQUEST_TIME = 2000; // ms after which an attempt has failed: the scope answers within 1.9 s
  const RETRY = 300; // ms between two attempts
  const KEPT = "hapticStop"; // name of a request that is not confirmed, in the tab's storage

  const { command, waiting, unreached, again } = document.currentScript.dataset;

  const stop = {
    /** True from a request until it is confirmed or dropped. */
    pending: false,

    /** Show how the request stands: "waiting", "OK" or "error". Replaced by the page's own line. */
    show(text, kind) {
      const message = document.getElementById("message");
      if (!message) return;
      Object.assign(message, { hidden: !text, textContent: text });
      message.dataset.state = kind;
    },

    /** Request the stop; a request that is pending goes on. */
    ask() {
      stop.show(waiting, "waiting");
      if (stop.pending) return;
      keep(true);
      repeat();
    },

    /** Request the stop no more. */
    drop: () => keep(false),
  };

  function keep(pending) {
    stop.pending = pending;
    try {
      if (pending) sessionStorage.setItem(KEPT, "true");
      else sessionStorage.removeItem(KEPT);
    } catch {
      // The browser keeps nothing for this page: the request lasts as long as the page.
    }
  }

  async function repeat() {
    while (stop.pending) {
      const [text, confirmed] = await attempt();
      if (!stop.pending) return;
      if (confirmed) stop.drop();
      stop.show(confirmed ? text : `${text}${again}`, confirmed ? "OK" : "error");
      if (!confirmed) await new Promise((resolve) => setTimeout(resolve, RETRY));
    }
  }

  /** Ask once; return what came of it, and whether the stop is confirmed. */
  async function attempt() {
    try {
      const answer = await fetch("/command", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: command,
        signal: AbortSignal.timeout(REQUEST_TIME),
      });
      const text = await answer.text();
      return [answer.headers.get("Content-Type").includes("json") ? JSON.parse(text).message : text, answer.ok];
    } catch {
      return [unreached, false];
    }
  }

  document.addEventListener("click", ({ target }) => target.closest("#stop") && stop.ask());
  document.addEventListener("keydown", (event) => {
    // In the dialog, Escape closes the dialog and everything stays stopped.
    if (event.key === "Escape" && !event.repeat && !document.getElementById("confirm")?.open) stop.ask();
  });
  try {
    if (sessionStorage.getItem(KEPT)) stop.ask();
  } catch {
    // nothing is kept
  }
  return stop;
})();
