// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Loads the page's script, and again until it has come: a browser tries each load once, and shows nothing
// when it is refused. Inline in the page, as is the stop, so that it needs no load itself.
(() => {
  const RETRY = 500; // ms between a load that failed and the next
  const SLOW = 5000; // ms without an answer after which another load is tried beside the first

  const { source } = document.currentScript.dataset;
  let loads = 0;

  function tell(text) {
    const line = document.getElementById("missing");
    if (!line) return;
    line.hidden = !text;
    line.querySelector("[lang]").textContent = text;
  }

  /** Load the script; each load has its own address, so that none waits for the one before. */
  function load() {
    const script = document.createElement("script");
    let failed = false;
    const again = (pause) => {
      if (failed || window.hapticPage) return;
      failed = true;
      tell("scripts missing: loading again");
      setTimeout(load, pause);
    };
    script.src = `${source}?load=${++loads}`;
    script.addEventListener("error", () => again(RETRY));
    script.addEventListener("load", () =>
      tell(window.hapticPage === "started" ? "" : "this page's script failed: reload the page"),
    );
    setTimeout(again, SLOW, 0);
    document.head.append(script);
  }

  document.addEventListener("DOMContentLoaded", () => {
    if (document.getElementById("end")) {
      load();
      return;
    }
    tell("a part of this page is missing: loading again");
    setTimeout(() => location.reload(), RETRY);
  });
})();
