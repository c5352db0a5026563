// The picture, its overlay, and drawing a target: by pointer, touch or keyboard.
import * as editor from "./box_editor.js";
import * as heatmap from "./heatmap.js";
import * as recording from "./recording.js";
import * as targets from "./targets.js";
import * as timeline from "./timeline.js";
import * as zoom from "./zoom.js";

const at = (id) => document.getElementById(id);
const overlay = at("overlay"), picture = at("picture"), context = picture.getContext("2d", { alpha: false });
const { place, set } = editor;
const TRAIL_SECONDS = 3;
const DOUBLE_CLICK = 300;  // milliseconds in which a zoomed picture waits for a second click
const ELLIPSE = Math.sqrt(5.991);  // 95 % region of a normal distribution in two dimensions

let send, note, showNewest;
let frame = null;        // the displayed frame
let newest = null;       // [frame, bitmap] received while the picture is frozen
let past = false;        // whether an earlier frame is shown, to look at it again
let mode = "live";       // live, drawing (the pointer is down), editing, or sent
let last = null;         // the last box sent, [x, y, width, height]
let trail = [], selected = "";  // path of the selected target, and its id
let paused = false;
let opening = false;     // a recording is being opened: nothing can be drawn
let blank = false;       // no overlay, as there is no current status
let blankState = "";     // the state while blank
let suggested = null;    // box to suggest for the first target, null for one in the middle
let before = null;       // mode and box before the pointer went down
let clicked = null;      // timer of a click
let space = "";          // the space key: "held", "panned" if the picture was moved with it, else ""
let hadTarget = false;   // whether there was a target, so that the user needs no hint

export function show(next, bitmap) {
  if (mode !== "live" || past) {
    newest?.[1].close();
    newest = [next, bitmap];
    return;
  }
  paint(next, bitmap);
}

export const isPast = () => past;

// Shows an earlier frame again, until `live`; targets can be drawn on it.
export function showPast(earlier, bitmap) {
  if (mode !== "live") { bitmap.close(); return; }
  past = true;
  at("past").hidden = false;
  paint(earlier, bitmap);
}

function paint(next, bitmap) {
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
    zoom.fit();
  }
  drawOverlay();
}

// Begins a recording: the user is told what to do until its first target, unless a tour does.
export function begin(box, hasHint) {
  past = false;
  live();
  // The picture of the last recording stays, but nothing can be drawn on it.
  [frame, last] = [null, null];
  targets.clear();
  overlay.dataset.state = "";
  [suggested, hadTarget] = [box, !hasHint];
}

// Shows what to do, and a ghost of the box to draw. A suggested box is of the first frame, and shown there each time.
function showHint(state) {
  hadTarget ||= Boolean(state) && !["idle", "skipped"].includes(state);
  const isSuggested = Boolean(suggested) && frame.index === 0, isIdle = mode === "live" && state === "idle" && !opening;
  const shown = isIdle && (isSuggested || (!hadTarget && !targets.hasDetector())), hasGhost = shown && (isSuggested || !suggested);
  at("hint").hidden = !shown;
  at("ghost").toggleAttribute("hidden", !hasGhost);
  if (!hasGhost) return;
  const [x, y, width, height] = suggested ?? editor.centeredBox([frame.width, frame.height]);
  const [rect, pointer] = at("ghost").children, unit = frame.width / (overlay.clientWidth || frame.width);
  place(rect, [x, y, width, height]);
  set(pointer, { transform: `translate(${x + width} ${y + height}) scale(${unit})` });
  pointer.style.setProperty("--width", `${-width / unit}px`);
  pointer.style.setProperty("--height", `${-height / unit}px`);
}

// The status of a still picture is kept while blank, as no other comes for it.
export function setBlank(now, state) {
  if (now === blank && (!now || state === blankState)) return;
  [blank, blankState] = [now, state];
  trail = [];
  if (blank) targets.clear();
  if (frame && mode === "live") drawOverlay();
}

export function setPaused(now) {
  paused = now;
  at("pause").setAttribute("aria-pressed", paused);
  at("pause-word").textContent = paused ? "Resume" : "Pause";
}

// What was drawn on the last recording is discarded.
export function setOpening(now) {
  if (now === opening) return;
  opening = now;
  live();
}

// Whether there is a box that has not been sent, or was refused.
export const isEditing = () => mode === "editing";

// The outcome of the box that was sent; "unanswered" if the console has been restarted.
export function showOutcome(outcome, text = "") {
  if (mode !== "sent") return;
  if (outcome === "unanswered") note("the console restarted before its response; send the box again", false);
  // The node reports the wrong stamp; the advice depends on this page.
  if (outcome === "refused" && /stamp 0|time went back/.test(text)) note(`${text}; discard it, pause, then draw`, false);
  if (["refused", "unanswered"].includes(outcome) && editor.box()) edit(editor.box());
  else live();
}

function drawOverlay() {
  const { stamp, width, height } = frame, known = blank && !past ? { stamp, width, height } : frame;
  const values = known.status?.values ?? {}, box = boxIn(known), chosen = known.status?.selected ?? "";
  // Read before any change, as it would trigger another layout afterwards.
  const unit = frame.width / (overlay.clientWidth || frame.width);
  overlay.dataset.state = values.state ?? (blank && !past ? blankState : "");
  overlay.dataset.stamp = frame.stamp;
  overlay.dataset.box = JSON.stringify(box);
  overlay.dataset.selected = chosen;
  showHint(overlay.dataset.state);
  place(at("box"), box);
  place(at("halo"), box);
  heatmap.show(known);
  targets.show(known, unit);
  set(at("particles"), { d: (known.particles ?? []).map(([x, y, weight]) => {
    const side = unit * (1.5 + 5 * weight);
    return `M${(x - side / 2).toFixed(1)} ${(y - side / 2).toFixed(1)}h${side.toFixed(1)}v${side.toFixed(1)}h-${side.toFixed(1)}z`;
  }).join("") });
  drawCovariance(values, box);
  const seconds = Number(BigInt(frame.stamp) / 1000000n) / 1000;
  // A skipped frame has no results.
  if (values.state !== "skipped" && chosen !== selected) [trail, selected] = [[], chosen];
  trail = trail.filter(([time]) => time < seconds && seconds - time < TRAIL_SECONDS);
  if (box) trail.push([seconds, box[0] + box[2] / 2, box[1] + box[3] / 2]);
  set(at("trail"), { points: trail.map(([, x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ") });
}

// Of the selected target.
const boxIn = (frame) => frame.boxes?.[frame.status?.selected]?.box ?? null;

function drawCovariance({ covariance_xx: xx, covariance_xy: xy, covariance_yy: yy }, box) {
  const ellipse = at("covariance"), known = box && typeof xx === "number";
  ellipse.toggleAttribute("hidden", !known);
  if (!known) return;
  const mean = (xx + yy) / 2, difference = Math.hypot((xx - yy) / 2, xy);
  const [x, y] = [box[0] + box[2] / 2, box[1] + box[3] / 2];
  set(ellipse, {
    cx: x, cy: y, rx: ELLIPSE * Math.sqrt(mean + difference), ry: ELLIPSE * Math.sqrt(Math.max(0, mean - difference)),
    transform: `rotate(${90 * Math.atan2(2 * xy, xx - yy) / Math.PI} ${x} ${y})`,
  });
}

// Drawing

function setMode(next, box = editor.box()) {
  mode = next;
  const editing = mode === "editing";
  // Its buttons disappear.
  if (!editing && at("decide").contains(document.activeElement)) at("draw").focus();
  at("draw").setAttribute("aria-pressed", editing);
  at("decide").hidden = !editing;
  if (frame) showHint(overlay.dataset.state);
  at("frozen").hidden = mode === "live" || mode === "sent";
  at("numbers").disabled = !editing;
  at("stage").dataset.mode = mode;
  editor.show(box, editing);
}

// Shows the newest frame again, and all that come.
export function live() {
  const wasPast = past;
  past = false;
  at("past").hidden = true;
  timeline.look(null);
  setMode("live", null);
  if (newest) {
    const [next, bitmap] = newest;
    newest = null;
    show(next, bitmap);
  }
  if (wasPast) showNewest();
}

const edit = (box) => setMode("editing", box);

function sendBox() {
  if (!editor.box() || !frame) return;
  last = editor.box();
  request({ type: "target", box: last, stamp: frame.stamp });
}

// Without a connection the box stays, to be sent later.
function request(message) {
  if (!send(message)) { if (editor.box()) edit(editor.box()); else live(); return; }
  setMode("sent");
  note("sent; waiting for the tracker", true, true);
}

function onDown(event) {
  if (!frame || opening || event.button || mode === "sent" || !event.isPrimary) return;
  event.preventDefault();
  before = [mode, editor.box()];
  editor.grab(event);
  setMode("drawing");
}

// A second finger pans and zooms; what the first one has begun is no box.
function cancelDrawing() {
  if (mode !== "drawing") return;
  if (before[0] === "editing") edit(before[1]);
  else if (past) setMode("live", null);
  else live();
}

function onMove(event) {
  if (mode === "drawing") editor.drag(event);
  // A box that a click selects.
  else if (frame && mode === "live") overlay.classList.toggle("over", Boolean(targets.idAt(frame, editor.point(event))));
}

function onUp(event) {
  if (mode !== "drawing") return;
  if (editor.drop(event)) {
    sendBox();
    return;
  }
  const point = editor.point(event), on = frame;
  if (!zoom.isZoomed()) { click(point, on); return; }
  // A double click fits the picture, and starts nothing.
  if (past) setMode("live", null); else live();
  clearTimeout(clicked);
  clicked = setTimeout(() => { if (mode === "live") click(point, on); }, DOUBLE_CLICK);
}

function click(point, on) {
  const id = targets.idAt(on, point), chosen = on.status?.selected ?? "";
  if (targets.isMultiTarget() && (id || chosen)) { live(); targets.select(id, chosen); }
  else if (id) { live(); note("this target is selected; to follow something else, drag a box around it"); }
  else request({ type: "click", point, stamp: on.stamp });
}

function startDrawing() {
  if (!frame || opening) { note("there is no picture to draw on", false); return; }
  if (mode === "editing") { live(); return; }
  if (mode !== "live") return;
  edit((boxIn(frame) ?? last)?.map(Math.round) ?? editor.centeredBox([frame.width, frame.height]));
  note(matchMedia("(pointer: coarse)").matches ? "drag a box, or move this one by its corners" :
    "drag a box, or move this one with the arrow keys (shift: resize, alt: by a pixel); Enter sends it", true, true);
  at("stage").scrollIntoView({ block: "nearest" });
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || at("keys").open) return;
  const key = event.key.toLowerCase(), typing = event.target.matches("input, select, textarea");
  if (event.key === "Escape" && mode !== "live") discard();
  else if (event.key === "Escape" && past) live();
  else if (event.key === "Enter" && mode === "editing" && (!typing || event.target.closest("#numbers")) && !event.target.matches("button")) sendBox();
  else if (typing) return;
  else if (key === "?") at("keys").showModal();
  else if (event.key.startsWith("Arrow") && mode === "editing") editor.move(event);
  else if (event.key === "ArrowLeft" && recording.isOpen()) recording.back();
  else if (event.key === "Home" && recording.isOpen()) recording.first();
  else if (event.key === " " && !event.target.matches("button, summary")) holdSpace(event);
  else if (key === "+" || key === "=") zoom.zoomIn();
  else if (key === "-") zoom.zoomOut();
  else if (key === "0") zoom.fit();
  else if (key === "s") stop();
  else if (key === "r") startDrawing();
  else if (key === "h") heatmap.toggle();
  else if ((key === "n" || event.key === "ArrowRight") && recording.isOpen()) recording.step();
  else return;
  event.preventDefault();
}

// The space key pauses when it is released, as a drag with it moves the picture.
function holdSpace({ repeat }) {
  if (!repeat) space = "held";
  at("stage").classList.add("grab");
}

function releaseSpace(isPress) {
  if (isPress && space === "held") pause();
  space = "";
  at("stage").classList.remove("grab");
}

// Whether a pointer that goes down pans.
function pansWithSpace() {
  space &&= "panned";
  return Boolean(space);
}

function pause() {
  if (recording.isOpen()) recording.toggle();
  else send({ type: "enable", enabled: paused });
}

function discard() {
  if (mode !== "sent") note("the box is discarded");
  live();
}

function showMore() {
  at("more").hidden = !at("more").hidden;
  at("more-button").ariaExpanded = !at("more").hidden;
}

function stop() {
  live();
  send({ type: "stop" });
}

// A control that was used by pointer loses the focus, so that the shortcuts work.
function freeKeys() {
  let byPointer = false;
  document.addEventListener("pointerdown", () => { byPointer = true; }, true);
  document.addEventListener("keydown", () => { byPointer = false; }, true);
  document.addEventListener("click", ({ target }) => { if (byPointer) target.closest("button, a, summary")?.blur(); });
  document.addEventListener("change", ({ target }) => { if (byPointer && target.matches("select, [type=range], [type=checkbox]")) target.blur(); });
}

export function init(sender, notes, newest) {
  [send, note, showNewest] = [sender, notes, newest];
  editor.init(() => frame && [frame.width, frame.height]);
  overlay.addEventListener("pointerdown", onDown);
  overlay.addEventListener("pointermove", onMove);
  overlay.addEventListener("pointerup", onUp);
  overlay.addEventListener("pointercancel", live);
  overlay.addEventListener("dblclick", () => { if (zoom.isZoomed()) { clearTimeout(clicked); zoom.fit(); } });
  zoom.init(pansWithSpace, cancelDrawing);
  // Handles, labels and particles keep their size on the screen.
  new ResizeObserver(() => { if (frame) { drawOverlay(); editor.show(editor.box(), mode === "editing"); } }).observe(overlay);
  document.addEventListener("keydown", onKey);
  document.addEventListener("keyup", ({ key }) => { if (key === " ") releaseSpace(true); });
  addEventListener("blur", () => releaseSpace(false));
  freeKeys();
  at("keys-button").addEventListener("click", () => at("keys").showModal());
  at("draw").addEventListener("click", (event) => {
    startDrawing();
    // By key, the next Enter tracks the box instead of discarding it.
    if (!event.detail && mode === "editing") at("send").focus();
  });
  at("pause").addEventListener("click", pause);
  at("stop").addEventListener("click", stop);
  at("now").addEventListener("click", live);
  at("send").addEventListener("click", sendBox);
  at("discard").addEventListener("click", discard);
  at("more-button").addEventListener("click", showMore);
}
