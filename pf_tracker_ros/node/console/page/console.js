// The connection to the console, and the display of its messages.
import * as heatmap from "./heatmap.js";
import * as legend from "./legend.js";
import * as plots from "./plots.js";
import * as recording from "./recording.js";
import * as stage from "./stage.js";
import * as targets from "./targets.js";
import * as timeline from "./timeline.js";
import { throttle } from "./throttle.js";
import * as tour from "./tour.js";
import * as tune from "./tune.js";

const RECONNECT = 500, RATE_WINDOW = 2000, HEALTH_DELAY = 200, NOTE_SHOWN = 10000;  // milliseconds
const UNSENT = "not connected to the console; nothing was sent";
const HOW = ": drag a box around it", DETECTOR = ": the detector finds it, or drag a box around one";
const FIGURES = 200;  // milliseconds between two updates of the figures
const at = (id) => document.getElementById(id);
const text = (id, content) => { if (at(id).textContent !== content) at(id).textContent = content; };
const number = (value, digits) => typeof value === "number" ? value.toFixed(digits) : "–";

let drawing = Promise.resolve();  // resolves once all received frames are drawn
let drawOnRequest = false, draw = () => {};  // whether frames wait for a request, and the function that draws the newest
let healthDue = null;  // timer; the next frame shows it, so that the browser lays out once
let socket = null, health = {}, lastStatus = null, drawn = [];  // [time, bytes] of the last frames
let told = null, why = "";  // status of the displayed frame, and why its selected or only target is out of sight
let noteTimer = null;  // clears the note
let failed = "";  // error of the last frame
let accepted = "", isTracked = false;  // note about an accepted target, and whether a frame has shown the target

// Returns whether the message was sent.
export function send(message) {
  const open = socket?.readyState === WebSocket.OPEN;
  if (open) socket.send(JSON.stringify(message));
  else note(UNSENT, false);
  return open;
}

// A note without an error disappears after a while, unless it lasts.
export function note(content, ok = true, lasts = false) {
  text("note", content);
  at("note").dataset.level = ok ? "ok" : "error";
  clearTimeout(noteTimer);
  if (ok && !lasts) noteTimer = setTimeout(() => text("note", ""), NOTE_SHOWN);
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(`${scheme}//${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  // One frame after another: decoded in parallel, the older one might finish last.
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") { handle(JSON.parse(data)); return; }
    const requested = drawOnRequest && new Promise((resolve) => { draw = resolve; }), from = socket;
    // After an error the next frames are still drawn.
    drawing = drawing.then(() => show(data, requested)).catch(fail).then(() => {
      if (from.readyState === WebSocket.OPEN) from.send(JSON.stringify({ type: "frame_ack" }));
    });
  };
  socket.onclose = () => {
    draw();
    health = { tracker: "silent", level: "error", text: "There is no connection to the console; the page retries twice a second." };
    showHealth();
    setTimeout(connect, RECONNECT);
  };
}

const handlers = {
  welcome(message) {
    drawOnRequest = message.draw_on_request;
    send({ type: "welcome_ack" });
    if (at("note").textContent === UNSENT) note("");
    sendView();
    // A target sent to the previous console gets no response.
    stage.showOutcome("unanswered");
    text("name", message.tracker.replace(/^\//, ""));
    tour.setRecordings(message.recordings);
    heatmap.request();
  },
  draw() { draw(); },
  health(message) {
    health = message;
    if (isStatusOld()) showHealth(); else healthDue ??= setTimeout(showHealth, HEALTH_DELAY);
  },
  note(message) {
    note(message.text, message.ok);
    if (!message.ok && ["target", "click"].includes(message.about)) stage.showOutcome("refused");
  },
  recording(message) {
    const wasOpening = recording.isOpening();
    recording.show(message);
    if (recording.isOpening() !== wasOpening) { showState(health.state); showHealth(); }
  },
  parameters(message) {
    tune.show(message.parameters);
    const value = (name) => message.parameters.find((one) => one.name === name)?.value;
    plots.setCues(value("cues") ?? ["correlation_response"]);
    targets.setMaxTargets(value("max_targets") ?? 1);
    targets.setDetector((value("built_in_detector") ?? "none") !== "none");
    showHealth();
  },
  detections: targets.setDetections,
  set(message) { tune.showRefusal(message.name, message.refusal); },
  target_response(message) {
    // A user with an unsent box does not need news of another page's target.
    if (!stage.isEditing()) note(message.text, message.outcome !== "refused", message.outcome === "waiting");
    [accepted, isTracked] = [message.outcome === "accepted" ? message.text : "", false];
    stage.showOutcome(message.outcome, message.text);
  },
};

function handle(message) { handlers[message.type]?.(message); }

// The frame of a message, and its bitmap, null without a picture.
async function unpack(data) {
  const view = new DataView(data), length = view.getUint32(0);
  const frame = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const jpeg = new Uint8Array(data, 4 + length);
  const bitmap = jpeg.length ? await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).catch(() => null) : null;
  frame.columns = bitmap?.width;
  if (jpeg.length && !bitmap) frame.error = "the browser cannot show the picture";
  return [frame, bitmap];
}

async function show(data, requested) {
  const [received, bitmap] = await unpack(data);
  await requested;
  const frame = targets.withChoice(received);
  // A skipped frame has no results.
  if (frame.status && frame.status.values.state !== "skipped") timeline.add(frame, targets.describe(frame), data);
  if (bitmap) stage.show(frame, bitmap);
  drawn.push([performance.now(), data.byteLength]);
  if (frame.error) note(frame.error, false);
  else if (failed && at("note").textContent === failed) note("");
  failed = frame.error ?? "";
  takeStatus(frame);
  if (healthDue) showHealth();
}

// Shows an earlier frame again.
async function showMoment(moment) {
  timeline.look(moment);
  if (!moment.data) { note(`${timeline.words(moment)}; its picture is no longer kept`); return; }
  const [frame, bitmap] = await unpack(moment.data);
  // Another may have been chosen meanwhile.
  if (!bitmap || timeline.looked() !== moment) return;
  stage.showPast(frame, bitmap);
  text("moment", timeline.words(moment));
  showStatus(frame);
  recording.showPosition();
}

// Shows the newest frame with a status again, unless there is a newer one by then.
async function showNewest() {
  const moment = timeline.last(), data = moment?.data;
  recording.showPosition();
  if (!data) return;
  const [received, bitmap] = await unpack(data);
  if (!bitmap || timeline.looked() || timeline.last() !== moment) return;
  const frame = targets.withChoice(received);
  stage.show(frame, bitmap);
  showStatus(frame);
}

// Looks at a position of the timeline.
function look(position, within) {
  const moment = timeline.find(position, within);
  if (recording.isOpen()) recording.look(position, moment);
  else if (moment && moment === timeline.last()) stage.live();
  else if (moment) showMoment(moment);
}

function fail(error) {
  reportError(error);
  note(`the page cannot show a frame: ${error.message}`, false);
}

// Clears the note about the accepted target. Frames of before the target may still come after it.
function clearAccepted() {
  if (accepted && at("note").textContent === accepted) note("");
  accepted = "";
}

// A late tracker leaves pictures without a status: they keep the last one.
function takeStatus(frame) {
  if (frame.status) {
    const { state } = frame.status.values;
    if (isTracked && state !== "tracking") clearAccepted();
    isTracked = Boolean(accepted && state && state !== "idle");
    lastStatus = performance.now();
    plots.add(frame.status.values, frame.status.targets);
  }
  if (!stage.isPast()) showStatus(frame);
}

function showStatus(frame) {
  frame.age = Date.now() - Number(BigInt(frame.stamp) / 1000000n);
  if (frame.status) {
    showState(frame.status.values.state);
    showEstimate(frame);
  }
  showPicture(frame);
}

const showEstimate = throttle(FIGURES, (frame) => {
  told = frame.status;
  const { targets: found, selected, values } = told;
  showConfidence(values.confidence);
  const own = found.find(({ id }) => id === selected) ?? (found.length === 1 ? found[0] : null);
  why = own ? targets.reason(own, frame) : "";
  if (!healthDue) showMessage();
  text("count", number(values.particles, 0));
  text("now-effective", number(values.effective_sample_size, 0));
  text("now-processing", typeof values.processing_time_ms === "number" ? `${number(values.processing_time_ms, 1)} ms` : "–");
});

const showPicture = throttle(FIGURES, (frame) => {
  if (frame.columns) text("jpeg", `${frame.quality}, ${frame.columns} px`);
  text("age", Math.abs(frame.age) < 60000 ? `${Math.max(0, frame.age)} ms` : "other clock");
  showRate();
});

// Without frames, only the diagnostics have the state.
const isStatusOld = () => performance.now() - lastStatus > 1000 || lastStatus === null;
const lacksImages = () => health.tracker === "alive" && isStatusOld() && health.text.startsWith("no image for");

function showState(state) {
  const now = recording.isOpening() ? "opening" : state === "skipped" && health.text.startsWith("paused") ? "paused" : state ?? "no status";
  const shown = health.tracker === "alive" ? now : health.tracker === "absent" ? "no tracker" : "silent";
  text("state", shown);
  at("state-card").dataset.state = health.tracker !== "alive" ? "none" : lacksImages() ? "old" : shown;
}

function showConfidence(confidence) {
  const isKnown = health.tracker === "alive" && typeof confidence === "number";
  text("confidence", isKnown ? `${Math.round(100 * confidence)} %` : "–");
  at("meter").value = typeof confidence === "number" ? confidence : 0;
}

function showHealth() {
  clearTimeout(healthDue);
  healthDue = null;
  const alive = health.tracker === "alive", isStale = isStatusOld();
  if (!alive) clearAccepted();
  text("connection", alive ? "connected" : socket.readyState === WebSocket.OPEN ? "no tracker" : "no console");
  at("connection").dataset.level = alive ? "ok" : "error";
  // An old picture is gray.
  at("stage").classList.toggle("old", lacksImages() || !alive);
  if (lacksImages() || !alive) text("age", "–");
  showMessage();
  const advice = health.text.startsWith("no image for") ? `\n\nStart a camera that publishes on ${health.image_topic}, or play a recording here: console drive.mcap` : "";
  text("missing", `No picture yet: ${health.text}${advice}`);
  text("topic", alive && health.image_topic ? `${health.image_topic} · ${(health.image_reliability ?? "").replace("_", " ")}` : "");
  // The last status of a paused recording holds until all targets are stopped.
  const holds = alive && recording.isPaused() && health.state !== "idle";
  if ((!alive || (isStale && !holds)) && !stage.isPast()) { showState(health.state); showConfidence(health.confidence); }
  const isBlank = !alive || (isStale && health.state === "idle");
  if (isBlank) for (const id of ["count", "now-effective", "now-processing"]) text(id, "–");
  stage.setBlank(isBlank, (alive && health.state) || "");
  stage.setPaused(alive && health.text.startsWith("paused"));
}

// What the state, which is shown large, does not tell; and why the shown target is out of sight. A frame that is looked
// back at has its own message.
function showMessage() {
  const isPast = stage.isPast() && told && health.tracker === "alive";
  const { message, level } = isPast ? told : { message: health.text, level: health.level };
  at("health").dataset.level = level;
  if (health.tracker !== "alive") { text("health", message); return; }
  if (recording.isOpening()) { text("health", "the recording is being opened"); return; }
  const isPlain = ["tracking", "occluded", "lost"].includes(message);
  // The status's words for the state of a single target say less than the reason.
  const general = why && told.targets.length === 1 && message.startsWith(told.message) ? told.message.length : 0;
  const advice = message === "waiting for a target" && lastStatus ? (targets.hasDetector() ? DETECTOR : HOW) : "";
  text("health", [isPlain ? "" : message.slice(general).replace(/^; /, "") + advice, why].filter(Boolean).join("; "));
}

// Reports the width of the picture, which limits the pixels sent.
function sendView() {
  const width = Math.round(at("overlay").clientWidth * devicePixelRatio);
  if (width && socket?.readyState === WebSocket.OPEN) send({ type: "view", width });
}

function showRate() {
  const now = performance.now();
  drawn = drawn.filter(([time]) => now - time < RATE_WINDOW);
  text("rate", `${number(1000 * drawn.length / RATE_WINDOW, 1)} frames/s`);
  text("link", `${number(8e-3 * drawn.reduce((sum, [, bytes]) => sum + bytes, 0) / RATE_WINDOW, 1)} Mbit/s`);
}
setInterval(() => { if (isStatusOld()) showRate(); }, 500);

heatmap.init(send);
legend.init();
recording.init(send, showMoment);
stage.init(send, note, showNewest);
targets.init(send, () => { if (recording.isPaused()) showNewest(); });
timeline.init(look);
tour.init(send);
tune.init(send);
new ResizeObserver(sendView).observe(at("overlay"));
connect();
