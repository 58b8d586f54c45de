// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The emergency stop: its button, its state, and whether the arms are engaged.
import { command, control, graph, tell } from "./commands.js";
import { byId, setState, setText } from "./elements.js";

const request = window.hapticStop; // of `stop_request.js`, where this page may stop a graph
const UNHEARD = new Set(["absent", "silent"]); // states of nodes that report nothing

/**
 * Show the state of the stop and of the arms.
 *
 * @param {object} state - of the graph, as the scope sends it
 */
export function showStop({ stop, engaged, nodes, metrics }) {
  // Beside a peer host there is one arm here.
  const devices = ["master", "slave"].filter((arm) => stop[arm] !== undefined);
  const answers = devices.map((arm) => stop[arm]);
  const stopped = stop.asked || answers.includes(true);
  // A device reports nothing about the stop before the first one.
  const heard = new Set(nodes.filter((row) => !UNHEARD.has(row.state)).map((row) => row.name));
  const known = devices.length && devices.every((arm) => heard.has(`${arm}_device`));
  const free = known ? ["OK", "no stop"] : ["absent", "stop: unknown"];
  setState(byId("stop-state"), ...(stopped ? ["error", "emergency stop"] : free));
  // Without vibration of the tool there is nothing to compare.
  const idle = metrics.rms_desired !== undefined && metrics.nrmse_percent === undefined;
  const coupled = idle ? ["warning", "arms engaged, no vibration"] : ["OK", "arms engaged"];
  const arms = engaged ? coupled : ["warning", "arms disengaged"];
  setState(byId("arms"), ...(engaged === null ? ["absent", "arms: unknown"] : arms));
  const text = answers.every((answer) => answer === true)
    ? "Emergency stop: no force until it is released."
    : "Emergency stop: not confirmed by every device.";
  setText(byId("alarm"), stopped ? text : "");
  byId("alarm").hidden = !stopped;
  if (control && graph) byId("release").hidden = !(stopped || request.pending);
}

/** Show how a request for the stop stands, and let a dialog release the stop. */
export function listenToStop() {
  const confirm = byId("confirm");
  request.show = tell;
  byId("release").addEventListener("click", () => confirm.showModal());
  byId("keep").addEventListener("click", () => confirm.close());
  byId("really").addEventListener("click", () => {
    confirm.close();
    request.drop();
    command("estop", false);
  });
}
