// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The live scope's page: takes what the scope sends, and draws it for each picture of the screen.
// Units are SI until they are shown.
import { fail, found, lost, startWatching } from "./age_chip.js";
import { forgetColours } from "./axes.js";
import { isOtherAxis, showAxes } from "./axis_choice.js";
import { age, serverClock } from "./clocks.js";
import { cloudPlot, showCloud } from "./cloud_plot.js";
import { control, graph, listenToChoices, showChoice, tell } from "./commands.js";
import { connect } from "./connection.js";
import { decode } from "./frames.js";
import { showNodes, showRecorder } from "./nodes.js";
import { describe, drawGauges, showActuator, showNumbers } from "./readings.js";
import { scene } from "./scene.js";
import { view } from "./side_view.js";
import { sound } from "./sound.js";
import { showSpectra, spectraPlot } from "./spectra_plot.js";
import { listenToStop, showStop } from "./stop.js";
import { held, listenToTimePlots, timePlots } from "./time_plots.js";
import { showTouch } from "./touch.js";
import { TRACES, traces } from "./traces.js";

const PROMPT = 20; // ms to the next picture of a machine that draws all of them
const LEFT = 4; // of the time that plots cost beyond that, part that they leave to others
const CALM = 250; // ms between two frames if the user prefers reduced motion
const HEARD = 45; // ms between two frames where they hold up the sound
const DESCRIBE = 5000; // ms between two descriptions of a plot for screen readers

const calm = matchMedia("(prefers-reduced-motion: reduce)");
const dark = matchMedia("(prefers-color-scheme: dark)");
const tally = { drawn: 0, frames: 0, bytes: 0, states: 0 };
let state = null; // of the graph, as it came last

function forget() {
  for (const trace of Object.values(traces)) trace.count = 0; // the last seconds come again
  age.forget();
  scene.forget();
}

function takeFrame(buffer) {
  tally.frames++;
  tally.bytes += buffer.byteLength;
  const frame = decode(buffer);
  if (frame.kind === "samples") takeSamples(frame);
  else if (frame.kind === "places") scene.take(frame.places);
  else if (frame.kind === "plots" && held === null) {
    showSpectra(frame);
    showCloud(frame, state?.metrics.slope);
  }
}

function takeSamples({ axis, age: sentAge, sent, origin, signals }) {
  if (isOtherAxis(axis)) forget();
  for (const { name, offsets, values } of signals) {
    traces[name].push(origin, offsets, values);
    sound.take(name, origin, offsets, values, state?.metrics.rate);
  }
  serverClock.meet(Math.max(traces.desired.newest, traces.actual.newest));
  age.meet(sentAge, sent);
}

function takeState(received) {
  if (received.refused) {
    scene.letGo();
    tell(received.refused, "error");
    return;
  }
  if (state !== null && state.version !== received.version) {
    location.reload(); // another scope, with other controls
    return;
  }
  state = received;
  tally.states++;
  if (held === null) showNumbers(state.metrics);
  showAxes(state.axes);
  showActuator(state.actuator, state.limits);
  showNodes(state.nodes);
  if (graph) showRecorder(state.nodes, state.recorder);
  scene.show(state);
  showTouch(state);
  for (const action of ["controller", "surface", "grip"]) showChoice(action, state[action]);
  showChoice("engage", state.engaged);
  showStop(state);
  found();
}

let drawnAt = 0; // ms
let plottedAt = 0; // ms, when the plots over time were drawn last
let plotsRest = 0; // ms that they then leave to the scene and the sound

function draw(moment) {
  requestAnimationFrame(draw);
  const pause = calm.matches && !scene.isGripped() ? CALM : sound.heldUp ? HEARD : 0;
  if (moment - drawnAt < pause) return;
  // A picture that comes late shows what the plots in the one before have cost.
  if (plottedAt === drawnAt) plotsRest = LEFT * Math.max(0, moment - drawnAt - PROMPT);
  drawnAt = moment;
  scene.draw();
  if (serverClock.offset === null || held !== null) return;
  tally.drawn++;
  if (moment - plottedAt < plotsRest) return;
  plottedAt = moment;
  for (const one of timePlots) one.draw();
  if (state) drawGauges(state.limits);
}

dark.addEventListener("change", () => {
  forgetColours();
  for (const one of [...timePlots.map(({ plot }) => plot), spectraPlot, cloudPlot, scene]) one.redraw();
});
listenToTimePlots();
if (control) listenToChoices();
if (control && graph) listenToStop();
scene.start();
// A browser gives sound only after the user has acted; on a page for touching that is to touch.
if (!graph) view.addEventListener("pointerdown", () => sound.turnOn(), { once: true });
sound.start();
startWatching();
setInterval(() => state && !lost && describe(state), DESCRIBE);
connect({ opened: forget, frame: takeFrame, state: takeState, failed: fail });
requestAnimationFrame(draw);

// What was received and drawn so far, for tests and debugging.
Object.assign(window, {
  hapticScene: scene,
  hapticSound: sound,
  hapticScope: {
    counters: tally,
    get state() {
      return state;
    },
    samples: () => Object.fromEntries(TRACES.map((name) => [name, traces[name].count])),
    newest: () => traces.actual.newest,
    view: () => [timePlots[0].plot.scales.x.min, timePlots[0].plot.scales.x.max],
  },
});
