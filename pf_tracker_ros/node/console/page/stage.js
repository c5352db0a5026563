// The picture, what is drawn over it, and drawing a target: by pointer, touch or keyboard.
import * as heat from "./heat.js";
import * as recording from "./recording.js";
import * as targets from "./targets.js";

const at = (id) => document.getElementById(id);
const overlay = at("overlay"), picture = at("picture"), context = picture.getContext("2d");
const TRAIL_SECONDS = 3, CLICK = 4, HANDLE = 7, NUMBERS = ["x", "y", "width", "height"];
const ELLIPSE = Math.sqrt(5.991);  // holds 95 % of a plane's normal distribution

let send, note;
let frame = null;        // as shown
let newest = null;       // [frame, bitmap] that came while the picture is frozen
let mode = "live";       // live, drawing (the pointer is down), editing, or sent
let drawn = null;        // [x, y, width, height] of the box being drawn
let last = null;         // of the one before
let grip = null;         // what a pointer that is down moves
let trail = [];
let paused = false;
let blank = false;       // nothing is drawn over the picture, as nothing is known of it

export function show(next, bitmap) {
  if (mode !== "live") {
    newest?.[1].close();
    newest = [next, bitmap];
    return;
  }
  frame = next;
  blank = false;
  at("missing").hidden = true;
  if (picture.width !== bitmap.width || picture.height !== bitmap.height) {
    picture.width = bitmap.width;
    picture.height = bitmap.height;
  }
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const viewBox = `0 0 ${frame.width} ${frame.height}`;
  if (overlay.getAttribute("viewBox") !== viewBox) {
    overlay.setAttribute("viewBox", viewBox);
    at("stage").style.setProperty("--ratio", frame.width / frame.height);
    trail = [];
  }
  drawOverlay();
}

// The answer to the frame comes back with the tracker: a picture that stands still gets no other.
export function setBlank(now) {
  if (now === blank) return;
  blank = now;
  trail = [];
  if (frame && mode === "live") drawOverlay();
}

export function setPaused(now) {
  paused = now;
  at("pause").setAttribute("aria-pressed", paused);
}

// How the tracker took the box that was sent.
export function judge(outcome) {
  if (mode !== "sent") return;
  if (outcome === "refused" && drawn) edit(drawn);
  else live();
}

function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

function place(element, box) {
  element.hidden = !box;
  element.toggleAttribute("hidden", !box);
  if (box) set(element, { x: box[0], y: box[1], width: Math.max(0, box[2]), height: Math.max(0, box[3]) });
}

function drawOverlay() {
  const { stamp, width, height } = frame, known = blank ? { stamp, width, height } : frame;
  const values = known.status?.values ?? {}, box = known.box ?? null;
  overlay.dataset.state = values.state ?? "";
  overlay.dataset.stamp = frame.stamp;
  overlay.dataset.box = JSON.stringify(box);
  place(at("box"), box);
  place(at("halo"), box);
  heat.show(known);
  targets.show(known);
  const unit = frame.width / overlay.clientWidth || 1;
  set(at("particles"), { d: (known.particles ?? []).map(([x, y, weight]) => {
    const side = unit * (1.5 + 5 * weight);
    return `M${(x - side / 2).toFixed(1)} ${(y - side / 2).toFixed(1)}h${side.toFixed(1)}v${side.toFixed(1)}h-${side.toFixed(1)}z`;
  }).join("") });
  drawCovariance(values, box);
  const seconds = Number(BigInt(frame.stamp) / 1000000n) / 1000;
  if (values.frame === "started") trail = [];
  trail = trail.filter(([time]) => time <= seconds && seconds - time < TRAIL_SECONDS);
  if (box) trail.push([seconds, box[0] + box[2] / 2, box[1] + box[3] / 2]);
  set(at("trail"), { points: trail.map(([, x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ") });
}

function drawCovariance({ covariance_xx: xx, covariance_xy: xy, covariance_yy: yy }, box) {
  const ellipse = at("covariance"), known = box && typeof xx === "number";
  ellipse.toggleAttribute("hidden", !known);
  if (!known) return;
  const middle = (xx + yy) / 2, spread = Math.hypot((xx - yy) / 2, xy);
  const [x, y] = [box[0] + box[2] / 2, box[1] + box[3] / 2];
  set(ellipse, {
    cx: x, cy: y, rx: ELLIPSE * Math.sqrt(middle + spread), ry: ELLIPSE * Math.sqrt(Math.max(0, middle - spread)),
    transform: `rotate(${90 * Math.atan2(2 * xy, xx - yy) / Math.PI} ${x} ${y})`,
  });
}

// Drawing

function setMode(next) {
  mode = next;
  const editing = mode === "editing";
  at("draw").setAttribute("aria-pressed", editing);
  at("frozen").hidden = mode === "live";
  at("numbers").disabled = !editing;
  at("stage").dataset.mode = mode;
  drawBox();
}

function live() {
  drawn = grip = null;
  setMode("live");
  if (newest) {
    const [next, bitmap] = newest;
    newest = null;
    show(next, bitmap);
  }
}

function edit(box) {
  drawn = box;
  setMode("editing");
}

function drawBox() {
  place(at("drawn"), drawn);
  const editing = drawn && mode === "editing", unit = frame ? frame.width / overlay.clientWidth : 1;
  at("handles").toggleAttribute("hidden", !editing);
  if (!drawn) return;
  const [x, y, width, height] = drawn;
  const corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]];
  [...at("handles").children].forEach((circle, i) =>
    set(circle, { cx: corners[i][0], cy: corners[i][1], r: HANDLE * unit }));
  NUMBERS.forEach((name, i) => { if (document.activeElement !== at(`box-${name}`)) at(`box-${name}`).value = Math.round(10 * drawn[i]) / 10; });
}

function sendBox() {
  if (!drawn || !frame) return;
  last = drawn;
  setMode("sent");
  note("sent; waiting for the tracker");
  send({ type: "target", box: drawn, stamp: frame.stamp });
}

function point(event) {
  const area = overlay.getBoundingClientRect();
  return [(event.clientX - area.left) * frame.width / area.width, (event.clientY - area.top) * frame.height / area.height];
}

const span = ([x, y], [u, v]) => [Math.min(x, u), Math.min(y, v), Math.abs(u - x), Math.abs(v - y)];

function onDown(event) {
  if (!frame || event.button || mode === "sent" || !event.isPrimary) return;
  event.preventDefault();
  overlay.setPointerCapture(event.pointerId);
  const start = point(event), corner = [...at("handles").children].indexOf(event.target);
  if (mode === "editing" && corner >= 0) {
    const [x, y, width, height] = drawn;
    const opposite = [[x + width, y + height], [x, y + height], [x, y], [x + width, y]][corner];
    grip = (now) => span(opposite, now);
  } else if (mode === "editing" && event.target === at("drawn")) {
    const box = drawn;
    grip = (now) => [box[0] + now[0] - start[0], box[1] + now[1] - start[1], box[2], box[3]];
  } else {
    grip = (now) => span(start, now);
    grip.start = [event.clientX, event.clientY];
    drawn = [...start, 0, 0];
  }
  setMode("drawing");
}

function onMove(event) {
  if (mode !== "drawing") return;
  drawn = grip(point(event));
  drawBox();
}

function onUp(event) {
  if (mode !== "drawing") return;
  const isClick = grip.start && Math.hypot(event.clientX - grip.start[0], event.clientY - grip.start[1]) < CLICK;
  if (!isClick) {
    drawn = grip(point(event)).map((value) => Math.round(value * 100) / 100);
    sendBox();
    return;
  }
  const { stamp } = frame;
  drawn = null;
  setMode("sent");
  note("sent; waiting for the tracker");
  send({ type: "click", point: point(event), stamp });
}

function startDrawing() {
  if (!frame) { note("there is no picture to draw on", false); return; }
  if (mode === "editing") { live(); return; }
  if (mode !== "live") return;
  const [width, height] = [frame.width / 4, frame.height / 4];
  edit(frame.box ?? last ?? [(frame.width - width) / 2, (frame.height - height) / 2, width, height].map(Math.round));
  note("drag a box, or move this one with the arrow keys (with shift its size, with alt by a pixel); Enter sends it");
}

function moveBox(event) {
  const step = event.altKey ? 1 : Math.max(1, Math.round(frame.width / 80));
  const [dx, dy] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
  const [x, y, width, height] = drawn;
  drawn = event.shiftKey ? [x, y, Math.max(0, width + dx), Math.max(0, height + dy)] : [x + dx, y + dy, width, height];
  drawBox();
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey) return;
  const key = event.key.toLowerCase(), typing = event.target.matches("input, select, textarea");
  if (event.key === "Escape" && mode !== "live") { live(); note("nothing was sent"); }
  else if (event.key === "Enter" && mode === "editing" && (!typing || event.target.closest("#numbers")) && !event.target.matches("button")) sendBox();
  else if (typing) return;
  else if (event.key.startsWith("Arrow") && mode === "editing") moveBox(event);
  else if (event.key === " " && !event.target.matches("button, summary")) pause();
  else if (key === "s") stop();
  else if (key === "r") startDrawing();
  else if (key === "h") heat.toggle();
  else if (key === "n" && recording.isOpen()) recording.step();
  else return;
  event.preventDefault();
}

function pause() {
  if (recording.isOpen()) recording.toggle();
  else send({ type: "enable", enabled: paused });
}

function stop() {
  live();
  send({ type: "stop" });
}

export function begin(sender, notes) {
  [send, note] = [sender, notes];
  for (let i = 0; i < 4; i++) at("handles").append(document.createElementNS("http://www.w3.org/2000/svg", "circle"));
  overlay.addEventListener("pointerdown", onDown);
  overlay.addEventListener("pointermove", onMove);
  overlay.addEventListener("pointerup", onUp);
  overlay.addEventListener("pointercancel", live);
  document.addEventListener("keydown", onKey);
  at("draw").addEventListener("click", startDrawing);
  at("pause").addEventListener("click", pause);
  at("stop").addEventListener("click", stop);
  at("send").addEventListener("click", sendBox);
  NUMBERS.forEach((name, i) => at(`box-${name}`).addEventListener("input", (event) => {
    if (drawn && Number.isFinite(event.target.valueAsNumber)) { drawn = drawn.with(i, event.target.valueAsNumber); drawBox(); }
  }));
}
