// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The live scope's scene: a side view of what the tool touches, and the pointer that leads the hand.
// Frames of places are described in haptic_accel/scope/frames.py. Units are SI until they are shown.
"use strict";

const hapticScene = (() => {
  const PLACES = ["tool", "velocity", "handle", "force"];
  const ARROW = 0.008; // m that stand for 1 N of contact force
  const PRESSED = 0.01; // m by which the full pressure of a pen lowers the hand
  const KEY_STEP = 0.002; // m that an arrow key moves the hand
  const TRAIL = 90; // points of the speed-force plane that are shown: 1.5 s
  const FASTEST = 0.4; // m/s, end of that plane
  const HARDEST = 3.5; // N, end of that plane: what the arms' motors can give
  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

  const card = document.getElementById("scene-card");
  const view = document.getElementById("scene");
  const sheet = view.appendChild(document.createElement("canvas")).getContext("2d");
  const here = {};
  const counters = { places: 0, points: 0, drawn: 0 };
  let scope = null; // what scope.js gives: send, ask, plot, axis, colour
  let plane = null; // speed and force of the contact
  let trail = [];
  let near = null; // object that the tool is next to
  let drawing = null; // view, outlines and offset, as the scope serves them
  let name = null; // of the scene that is drawn
  let led = false;
  let inSight = false;
  let grip = null; // the pointer that leads, where it began and where the hand is to be

  const known = ([x, z]) => Number.isFinite(x) && Number.isFinite(z);
  const clamp = (value, [low, high]) => Math.min(high, Math.max(low, value));

  // ---- Where everything is ----------------------------------------------------------------

  function forget() {
    for (const place of PLACES) here[place] = [NaN, NaN];
    trail = [];
  }

  function take(buffer) {
    const values = new Float32Array(buffer, 4);
    PLACES.forEach((place, index) => (here[place] = [values[2 * index], values[2 * index + 1]]));
    counters.places++;
    const { force, velocity } = here;
    near = known(here.tool) ? nearest(here.tool) : null;
    if (!near || !known(force) || Math.hypot(...force) === 0) trail.push(null);
    else {
      const [nx, nz] = near.normal;
      trail.push([velocity[0] * nz - velocity[1] * nx, force[0] * nx + force[1] * nz].map(Math.abs));
    }
    trail = trail.slice(-TRAIL);
  }

  /** Object whose outline is next to a place, and the outline's normal there. */
  function nearest([x, z]) {
    let found = null;
    for (const [object, lines] of Object.entries(drawing?.outlines ?? {})) {
      for (const line of lines) {
        for (let i = 1; i < line.length; i++) {
          const [[x0, z0], [x1, z1]] = [line[i - 1], line[i]];
          const [dx, dz] = [x1 - x0, z1 - z0];
          const length = Math.hypot(dx, dz);
          if (!length) continue;
          const part = clamp(((x - x0) * dx + (z - z0) * dz) / length ** 2, [0, 1]);
          const distance = Math.hypot(x - x0 - part * dx, z - z0 - part * dz);
          if (!found || distance < found.distance) {
            found = { object, distance, normal: [-dz / length, dx / length] };
          }
        }
      }
    }
    return found;
  }

  // ---- The side view ----------------------------------------------------------------------

  /** Pixels per metre, and functions from metres to pixels of the canvas. */
  function mapping() {
    const [[left, right], [low, high]] = drawing.view;
    const { width, height } = sheet.canvas;
    const scale = Math.min(width / (right - left), height / (high - low));
    const x = (value) => width / 2 + (value - (left + right) / 2) * scale;
    const z = (value) => height / 2 - (value - (low + high) / 2) * scale;
    return { scale, x, z };
  }

  function draw() {
    if (card.hidden || !inSight || !drawing) return;
    const ratio = devicePixelRatio;
    const size = [view.clientWidth, view.clientHeight].map((pixels) => Math.round(pixels * ratio));
    if (sheet.canvas.width !== size[0]) sheet.canvas.width = size[0];
    if (sheet.canvas.height !== size[1]) sheet.canvas.height = size[1];
    sheet.clearRect(0, 0, ...size);
    const map = mapping();
    drawObjects(map, ratio);
    if (known(here.tool)) drawTool(map, ratio);
    drawPlane(ratio);
    counters.drawn++;
  }

  function drawObjects({ x, z }, ratio) {
    const colour = scope.colour();
    const { height } = sheet.canvas;
    sheet.lineWidth = 1.5 * ratio;
    sheet.font = `${12 * ratio}px system-ui, sans-serif`;
    for (const [object, lines] of Object.entries(drawing.outlines)) {
      for (const line of lines) {
        const points = line.map(([px, pz]) => [x(px), z(pz)]);
        const outline = new Path2D();
        points.forEach((point, index) => outline[index ? "lineTo" : "moveTo"](...point));
        const solid = new Path2D(outline);
        if (Math.hypot(points[0][0] - points.at(-1)[0], points[0][1] - points.at(-1)[1]) > 1) {
          // What leaves the view at both sides is solid below.
          solid.lineTo(points.at(-1)[0], height);
          solid.lineTo(points[0][0], height);
        }
        sheet.fillStyle = colour["still-fill"];
        sheet.fill(solid);
        sheet.strokeStyle = colour.quiet;
        sheet.stroke(outline);
      }
      if (!lines.length) continue;
      const corners = lines.flat();
      const centre = [0, 1].map((axis) => {
        const values = corners.map((corner) => corner[axis]);
        return (Math.min(...values) + Math.max(...values)) / 2;
      });
      const flat = lines.every((line) => line.every(([, pz]) => Math.abs(pz - line[0][1]) < 1e-6));
      sheet.fillStyle = colour.quiet;
      sheet.textAlign = flat ? "left" : "center";
      sheet.fillText(object, flat ? 10 * ratio : x(centre[0]), z(centre[1]) + (flat ? 18 : 4) * ratio);
    }
  }

  function drawTool({ scale, x, z }, ratio) {
    const colour = scope.colour();
    const [tx, tz] = [x(here.tool[0]), z(here.tool[1])];
    const width = 5 * ratio;
    sheet.beginPath(); // a stylus on its tip
    sheet.moveTo(tx, tz);
    sheet.lineTo(tx - width, tz - 3 * width);
    sheet.lineTo(tx - width, tz - 16 * width);
    sheet.lineTo(tx + width, tz - 16 * width);
    sheet.lineTo(tx + width, tz - 3 * width);
    sheet.closePath();
    sheet.fillStyle = colour.desired;
    sheet.fill();
    if (known(here.handle)) {
      const place = here.handle.map((value, axis) => value + drawing.offset[axis]);
      sheet.beginPath();
      sheet.arc(x(place[0]), z(place[1]), 9 * ratio, 0, 2 * Math.PI);
      sheet.lineWidth = 2.5 * ratio;
      sheet.strokeStyle = colour.actual;
      sheet.stroke();
    }
    const [fx, fz] = here.force.map((value) => value * ARROW * scale);
    const length = Math.hypot(fx, fz);
    if (!(length > 1)) return;
    const head = Math.min(length, 7 * ratio);
    sheet.save();
    sheet.translate(tx - fx, tz + fz); // it ends at the tip, clear of the stylus
    sheet.rotate(Math.atan2(-fz, fx));
    sheet.fillStyle = colour.force;
    sheet.fillRect(0, -1.5 * ratio, length - head / 2, 3 * ratio);
    sheet.beginPath();
    sheet.moveTo(length, 0);
    sheet.lineTo(length - head, -head * 0.7);
    sheet.lineTo(length - head, head * 0.7);
    sheet.fill();
    sheet.restore();
  }

  // ---- The speed-force plane --------------------------------------------------------------

  function makePlane() {
    const options = {
      scales: { x: { time: false, range: () => [0, 1e3 * FASTEST] }, y: { range: () => [0, HARDEST] } },
      series: [{}, {}],
      axes: [scope.axis("speed (mm/s)"), scope.axis("force (N)", { size: 34 })],
    };
    const made = scope.plot("plane", options, [[0, 1e3 * FASTEST], [null, null]]);
    const ink = made.root.parentElement.appendChild(document.createElement("canvas")).getContext("2d");
    return { made, ink };
  }

  function drawPlane(ratio) {
    const { made, ink } = plane;
    const { width, height } = made.ctx.canvas;
    if (ink.canvas.width !== width) ink.canvas.width = width;
    if (ink.canvas.height !== height) ink.canvas.height = height;
    ink.clearRect(0, 0, width, height);
    const box = made.bbox;
    const dot = ([speed, force], radius) => {
      const [right, up] = [clamp(speed / FASTEST, [0, 1]), clamp(force / HARDEST, [0, 1])];
      ink.beginPath();
      ink.arc(box.left + right * box.width, box.top + (1 - up) * box.height, radius * ratio, 0, 2 * Math.PI);
      ink.fill();
    };
    ink.fillStyle = scope.colour().quiet;
    for (const node of drawing.nodes[near?.object] ?? []) dot(node, 1.5);
    ink.fillStyle = scope.colour().force;
    trail.forEach((point, index) => {
      if (!point) return;
      const last = index === trail.length - 1;
      ink.globalAlpha = last ? 1 : 0.35 * (index / trail.length);
      dot(point, last ? 6 : 3);
    });
    ink.globalAlpha = 1;
  }

  // ---- The pointer ------------------------------------------------------------------------

  /** Where a pointer wants the hand, m in the master's base frame. */
  function wanted(event) {
    const { scale } = mapping();
    const moved = [event.clientX - grip.began[0], grip.began[1] - event.clientY];
    const [x, z] = moved.map((pixels, axis) => grip.hand[axis] + (pixels * devicePixelRatio) / scale);
    return reached([x, z - (event.pointerType === "pen" ? PRESSED * event.pressure : 0)]);
  }

  const reached = (place) =>
    place.map((value, axis) => clamp(value, drawing.view[axis]));

  function grab(event) {
    if (!led || !drawing || grip || event.button || !known(here.handle)) return;
    view.setPointerCapture(event.pointerId);
    grip = { id: event.pointerId, began: [event.clientX, event.clientY], hand: here.handle };
    grip.point = wanted(event);
    lead();
  }

  /** Send the point for each picture, also while the pointer rests: so it is known to lead. */
  function lead() {
    if (!grip) return;
    send(grip.point);
    requestAnimationFrame(lead);
  }

  function send(point) {
    scope.send({ point });
    counters.points++;
  }

  function letGo() {
    if (grip) scope.send({ point: null });
    grip = null;
  }

  function press(event) {
    const step = ARROWS[event.key];
    if (!led || !drawing || !step || grip || !known(here.handle)) return;
    event.preventDefault();
    send(reached(here.handle.map((value, axis) => value + KEY_STEP * step[axis])));
    scope.send({ point: null });
  }

  view.addEventListener("pointerdown", grab);
  view.addEventListener("pointermove", (event) => {
    if (grip?.id === event.pointerId) grip.point = wanted(event);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    view.addEventListener(end, (event) => grip?.id === event.pointerId && letGo());
  }
  view.addEventListener("keydown", press);

  // ---- What scope.js calls ----------------------------------------------------------------

  function start(given) {
    scope = given;
    forget();
    new IntersectionObserver(([entry]) => {
      inSight = entry.isIntersecting;
      if (!inSight) forget(); // places come only while they are seen
      scope.ask();
    }).observe(card);
  }

  /** Follow the graph's state. */
  async function show(state) {
    led = Boolean(state.led);
    document.querySelector("main").classList.toggle("led", led);
    view.classList.toggle("led", led);
    view.tabIndex = led ? 0 : -1;
    document.getElementById("scene-hint").hidden = !led;
    const shown = state.scene ?? (led ? "" : null); // a hand can be led wherever the tool is
    if (shown === name) return;
    name = shown;
    card.hidden = name === null;
    if (name === null) return;
    plane ??= makePlane();
    try {
      const answer = await fetch("/scene");
      drawing = answer.ok ? await answer.json() : null;
    } catch {
      name = null; // asked again with the next state
    }
  }

  return {
    start,
    show,
    take,
    draw,
    letGo,
    forget,
    counters,
    get inSight() {
      return inSight && !card.hidden;
    },
    get gripped() {
      return grip !== null;
    },
    get here() {
      return here;
    },
    redraw: () => plane?.made.redraw(),
  };
})();
