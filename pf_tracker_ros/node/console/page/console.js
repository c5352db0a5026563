// Connects to the console, and shows what it tells.
import * as heatmap from "./heatmap.js";
import * as plots from "./plots.js";
import * as recording from "./recording.js";
import * as stage from "./stage.js";
import * as targets from "./targets.js";
import { throttle } from "./throttle.js";
import * as tune from "./tune.js";

const RECONNECT = 500, RATE_WINDOW = 2000, LATEST = 200, NOTED = 10000;  // milliseconds
const UNSENT = "not connected to the console; nothing was sent";
const HOW = ": drag a box around it on the picture, or click it";
const FIGURES = 200;  // nobody reads them faster
const at = (id) => document.getElementById(id);
const text = (id, content) => { if (at(id).textContent !== content) at(id).textContent = content; };
const number = (value, digits) => typeof value === "number" ? value.toFixed(digits) : "–";

let drawing = Promise.resolve();  // once the frames that came before are
let waits = false, draw = () => {};  // whether frames are drawn when that is told, and how the newest is
let healthDue = null;  // it is shown with the next frame, so that the browser draws once
let socket = null, health = {}, lastStatus = null, drawn = [];  // of the last frames, when and how many octets
let noted = null;  // when the note goes
let failed = "";  // why the last frame could not be shown
let taken = "", isFollowed = false;  // what the note says of a target that was taken, and whether a frame has shown it

// Whether it was sent.
export function send(message) {
  const open = socket?.readyState === WebSocket.OPEN;
  if (open) socket.send(JSON.stringify(message));
  else note(UNSENT, false);
  return open;
}

// What went well is soon no news, unless it lasts.
export function note(content, ok = true, lasts = false) {
  text("note", content);
  at("note").dataset.level = ok ? "ok" : "error";
  clearTimeout(noted);
  if (ok && !lasts) noted = setTimeout(() => text("note", ""), NOTED);
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(`${scheme}//${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  // One frame after another: of two that are decoded at once, the older one may be done later.
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") { take(JSON.parse(data)); return; }
    const told = waits && new Promise((resolve) => { draw = resolve; }), from = socket;
    // Whatever becomes of one, others follow.
    drawing = drawing.then(() => show(data, told)).catch(fail).then(() => {
      if (from.readyState === WebSocket.OPEN) from.send(JSON.stringify({ type: "frame_ack" }));
    });
  };
  socket.onclose = () => {
    draw();
    health = { tracker: "silent", level: "error", text: "The console does not answer; it is tried again twice a second." };
    showHealth();
    setTimeout(connect, RECONNECT);
  };
}

const handlers = {
  welcome(message) {
    waits = message.draw_on_request;
    send({ type: "welcome_ack" });
    if (at("note").textContent === UNSENT) note("");
    tellView();
    // What was sent before went to a console that has gone, and its answer with it.
    stage.showOutcome("unanswered");
    text("name", message.tracker.replace(/^\//, ""));
    heatmap.ask();
  },
  draw() { draw(); },
  health(message) {
    health = message;
    if (answerIsOld()) showHealth(); else healthDue ??= setTimeout(showHealth, LATEST);
  },
  note(message) {
    note(message.text, message.ok);
    if (!message.ok && ["target", "click"].includes(message.about)) stage.showOutcome("refused");
  },
  recording(message) { recording.show(message); },
  parameters(message) {
    tune.show(message.parameters);
    targets.setMaxTargets(message.parameters.find((one) => one.name === "max_targets")?.value ?? 1);
  },
  detections: targets.setDetections,
  set(message) { tune.showRefusal(message.name, message.refusal); },
  target_response(message) {
    // Of another page's box, whoever has one at hand need not know.
    if (!stage.isEditing()) note(message.text, message.outcome !== "refused", message.outcome === "waiting");
    [taken, isFollowed] = [message.outcome === "accepted" ? message.text : "", false];
    stage.showOutcome(message.outcome, message.text);
  },
};

function take(message) { handlers[message.type]?.(message); }

async function show(data, told) {
  const view = new DataView(data), length = view.getUint32(0);
  const frame = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const jpeg = new Uint8Array(data, 4 + length);
  if (jpeg.length) {
    const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).catch(() => null);
    await told;
    frame.columns = bitmap?.width;
    if (bitmap) stage.show(frame, bitmap);
    else frame.error = "the browser cannot show the picture";
  } else await told;
  drawn.push([performance.now(), data.byteLength]);
  if (frame.error) note(frame.error, false);
  else if (failed && at("note").textContent === failed) note("");
  failed = frame.error ?? "";
  showStatus(frame);
  if (healthDue) showHealth();
}

function fail(error) {
  reportError(error);
  note(`the page cannot show a frame: ${error.message}`, false);
}

// Frames of before the target may be drawn after it was taken.
function withdraw() {
  if (taken && at("note").textContent === taken) note("");
  taken = "";
}

function showStatus(frame) {
  const values = frame.status?.values ?? {};
  if (values.state === "idle" && isFollowed) withdraw();
  isFollowed = Boolean(taken && values.state && values.state !== "idle");
  lastStatus = performance.now();
  if (frame.status) plots.add(values, frame.status.targets);
  showState(values.state);
  frame.age = Date.now() - Number(BigInt(frame.stamp) / 1000000n);
  tellFigures(frame, values);
}

const tellFigures = throttle(FIGURES, (frame, values) => {
  tellConfidence(values.confidence);
  if (frame.columns) text("jpeg", `${frame.quality}, ${frame.columns} px`);
  text("count", number(values.particles, 0));
  text("effective", number(values.effective_sample_size, 0));
  text("processing", typeof values.processing_time_ms === "number" ? `${number(values.processing_time_ms, 1)} ms` : "–");
  text("age", Math.abs(frame.age) < 60000 ? `${Math.max(0, frame.age)} ms` : "–");
  tellRate();
});

// Without images, only the diagnostics tell how the target is.
const answerIsOld = () => performance.now() - lastStatus > 1000 || lastStatus === null;
const misses = () => health.tracker === "heard" && answerIsOld() && health.text.startsWith("no image for");

function showState(state) {
  const shown = health.tracker === "heard" ? state ?? "no answer" : health.tracker === "absent" ? "no tracker" : "silent";
  text("state", shown);
  at("state-card").dataset.state = health.tracker !== "heard" ? "none" : misses() ? "old" : shown;
}

function tellConfidence(confidence) {
  text("confidence", health.tracker === "heard" ? number(confidence, 2) : "–");
  at("meter").value = typeof confidence === "number" ? confidence : 0;
}

function showHealth() {
  clearTimeout(healthDue);
  healthDue = null;
  const heard = health.tracker === "heard", isOld = answerIsOld();
  if (!heard) withdraw();
  text("connection", heard ? "live" : socket.readyState === WebSocket.OPEN ? "no tracker" : "no console");
  at("connection").dataset.level = heard ? "ok" : "error";
  // A picture that is old looks so.
  at("stage").classList.toggle("old", misses() || !heard);
  if (misses() || !heard) text("age", "–");
  // The state alone is told in large.
  const isPlain = ["tracking", "occluded", "lost"].includes(health.text);
  text("health", isPlain ? "" : health.text + (health.text === "waiting for a target" && lastStatus ? HOW : ""));
  at("health").dataset.level = health.level;
  text("topic", heard && health.image_topic ? `${health.image_topic} · ${(health.image_reliability ?? "").replace("_", " ")}` : "");
  if (!heard || isOld) { showState(health.state); tellConfidence(health.confidence); }
  const isBlank = !heard || (isOld && health.state === "idle");
  if (isBlank) for (const id of ["count", "effective", "processing"]) text(id, "–");
  stage.setBlank(isBlank, (heard && health.state) || "");
  stage.setPaused(heard && health.text.startsWith("paused"));
}

// A picture needs no more pixels than it is shown with.
function tellView() {
  const width = Math.round(at("stage").clientWidth * devicePixelRatio);
  if (width && socket?.readyState === WebSocket.OPEN) send({ type: "view", width });
}

function tellRate() {
  const now = performance.now();
  drawn = drawn.filter(([time]) => now - time < RATE_WINDOW);
  text("rate", `${number(1000 * drawn.length / RATE_WINDOW, 1)} frames/s`);
  text("link", `${number(8e-3 * drawn.reduce((sum, [, octets]) => sum + octets, 0) / RATE_WINDOW, 1)} Mbit/s`);
}
setInterval(() => { if (answerIsOld()) tellRate(); }, 500);

heatmap.init(send);
recording.init(send);
stage.init(send, note);
targets.init(send);
tune.init(send);
new ResizeObserver(tellView).observe(at("stage"));
connect();
