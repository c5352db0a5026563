// Selecting frames of a recording, and drawing the targets on them.
import * as editor from "./box_editor.js";

const at = (id) => document.getElementById(id);
const overlay = at("overlay"), picture = at("picture"), seek = at("seek");
const HOW = "drag a box around the target; correct it by its corners or the arrow keys (shift: resize, alt: by a pixel); Enter starts, Escape drops it";
const MORE = "; A keeps it and adds another target";
const NOTHING = "there is no box yet: drag one around the target, or press R for one in the middle";
const NEXT = "drag a box around the next target, also in another frame; Enter starts, U undoes the last one";

let frame = null;        // { number, width, height } of the displayed frame
let mode = "browsing";   // browsing, drawing (the pointer is down), editing, sent, or done
let loading = false;
let nextFrame = null;    // number of the frame to show next
let kept = [];           // { frame, box, label } of the targets before the one that is edited
let maxTargets = 1;

function note(text, ok = true) {
  at("note").textContent = text;
  at("note").dataset.level = ok ? "ok" : "error";
}

function setMode(next, box = editor.box()) {
  mode = next;
  const editing = mode === "editing", over = mode === "sent" || mode === "done";
  at("numbers").disabled = !editing;
  at("add").disabled = !editing || kept.length + 1 >= maxTargets;
  at("undo").disabled = over || !(editing || kept.length);
  at("send").disabled = over || !(editing || kept.length);
  at("draw").setAttribute("aria-pressed", editing);
  for (const id of ["draw", "cancel", "back", "forward"]) at(id).disabled = over;
  seek.disabled = over || !Number(seek.max);
  at("stage").dataset.mode = mode;
  editor.show(box, editing);
  showKept();
}

// The picture has the targets of its frame, the list all.
function showKept() {
  const unit = (frame?.width ?? 1) / (overlay.clientWidth || 1);
  const here = kept.map((target, i) => [target, i + 1]).filter(([target]) => target.frame === frame?.number);
  at("kept").replaceChildren(...here.map(([{ box, label }, number]) => {
    const group = editor.labeledBox(), [rect, text] = group.children;
    editor.place(rect, box);
    text.textContent = `${number} ${label}`.trim();
    editor.set(text, { x: box[0], y: Math.max(box[1] - 4 * unit, 12 * unit), "font-size": 13 * unit });
    return group;
  }));
  at("list").replaceChildren(...kept.map(({ frame, box, label }) => {
    const line = document.createElement("li");
    line.textContent = `${label ? `${label}, ` : ""}frame ${frame}: ${box.map((value) => Math.round(10 * value) / 10).join(", ")}`;
    return line;
  }));
}

async function request(path, options) {
  const response = await fetch(path, options).catch(() => null);
  if (!response) return [false, "there is no response; track may have ended"];
  return [response.ok, response.ok && options === undefined ? response : await response.text()];
}

// One request at a time; of those made meanwhile only the last.
async function show(number) {
  nextFrame = Math.max(0, Math.min(number, Number(seek.max) || number));
  if (loading) return;
  loading = true;
  while (nextFrame !== null) {
    const now = nextFrame;
    nextFrame = null;
    const [ok, response] = await request(`/frame?number=${now}`);
    if (ok) await put(response);
    else note(response, false);
  }
  loading = false;
}

async function put(response) {
  const [width, height] = response.headers.get("X-Size").split(" ").map(Number);
  const bitmap = await createImageBitmap(await response.blob());
  frame = { number: Number(response.headers.get("X-Frame")), width, height };
  draw(bitmap);
  overlay.setAttribute("viewBox", `0 0 ${width} ${height}`);
  overlay.dataset.frame = frame.number;
  at("stage").style.setProperty("--ratio", width / height);
  at("missing").hidden = true;
  seek.value = frame.number;
  at("frame").textContent = Number(seek.max) ? `${frame.number} / ${seek.max}` : frame.number;
  editor.show(editor.box(), mode === "editing");
  showKept();
}

function draw(bitmap) {
  [picture.width, picture.height] = [bitmap.width, bitmap.height];
  picture.getContext("2d").drawImage(bitmap, 0, 0);
  bitmap.close();
}

const how = () => HOW + (kept.length + 1 < maxTargets ? MORE : "");

function edit(box) {
  setMode("editing", box);
  note(how());
}

function drop() {
  setMode("browsing", null);
  at("label").value = "";
  note(kept.length ? NEXT : how());
}

const edited = () => ({ frame: frame.number, box: editor.box(), label: at("label").value.trim() });

function add() {
  if (mode !== "editing" || kept.length + 1 >= maxTargets) return;
  document.activeElement?.blur();
  kept.push(edited());
  drop();
}

function undo() {
  if (!canEdit()) return;
  document.activeElement?.blur();
  if (mode === "browsing") kept.pop();
  drop();
}

async function decide(path, body) {
  const before = mode;
  setMode("sent");
  const [ok, text] = await request(path, { method: "POST", body });
  note(text, ok);
  setMode(ok ? "done" : before);
  if (ok && path === "/targets") watch();
}

// From here on the page shows the tracking: a stream of events, and the newest picture.
function watch() {
  at("heading").textContent = "Tracking";
  at("recording").hidden = at("actions").hidden = true;
  at("progress").hidden = false;
  overlay.setAttribute("hidden", "");
  const events = new EventSource("/progress");
  let shown = null, picture = null;
  events.addEventListener("message", (event) => {
    const now = JSON.parse(event.data);
    if (now.files) return finish(events, now, picture);
    if (now.frame === null || now.frame === shown) return;
    shown = now.frame;
    const { frame, frames, state, confidence, targets, rate } = now;
    if (frames) at("bar").value = (frame + 1) / frames;
    const found = targets > 1 ? `${targets} targets` : state + (confidence === null ? "" : ` ${confidence.toFixed(2)}`);
    at("now").textContent = `frame ${frame + 1}${frames ? ` of ${frames}` : ""}: ${found}, ${rate.toFixed(0)} frames/s`;
    picture = Promise.all([picture, showTracked()]);
  });
  events.addEventListener("error", () => {
    events.close();
    note("track has ended; the terminal has the reason", false);
  });
}

async function showTracked() {
  if (loading) return;
  loading = true;
  const [ok, response] = await request("/picture");
  if (ok) draw(await createImageBitmap(await response.blob()));
  loading = false;
}

// Track ends when the stream is closed, so no picture may be under way then.
async function finish(events, { text, files, report }, picture) {
  note(text);
  at("progress").hidden = true;
  at("heading").textContent = "Tracked";
  if (!report) {
    await picture;
    return events.close();
  }
  // The stream stays open: while it is, track serves the results.
  document.querySelector("main").dataset.shown = "report";
  at("files").replaceChildren(...files.map(([name, address]) => {
    const link = document.createElement("a");
    [link.textContent, link.href, link.target] = [name, address, "_blank"];
    return link;
  }));
  at("files").hidden = false;
  at("report").src = report;
  at("report").hidden = false;
}

function send() {
  const targets = mode === "editing" ? [...kept, edited()] : kept;
  if (!canEdit()) return;
  if (targets.length) decide("/targets", JSON.stringify({ targets }));
  else note(NOTHING, false);
}

const canEdit = () => mode === "browsing" || mode === "editing";
const step = (by) => { if (frame && canEdit()) show((nextFrame ?? frame.number) + by); };

function startDrawing() {
  if (!frame || !canEdit()) return;
  if (mode === "editing") drop();
  else edit(editor.centeredBox([frame.width, frame.height]));
}

overlay.addEventListener("pointerdown", (event) => {
  if (!frame || event.button || !event.isPrimary || !canEdit()) return;
  event.preventDefault();
  document.activeElement?.blur();
  editor.grab(event);
  setMode("drawing");
});
overlay.addEventListener("pointermove", (event) => { if (mode === "drawing") editor.drag(event); });
overlay.addEventListener("pointerup", (event) => {
  if (mode !== "drawing") return;
  const box = editor.drop(event);
  if (box) edit(box);
  else drop();
});
overlay.addEventListener("pointercancel", () => { if (mode === "drawing") drop(); });
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey) return;
  const key = event.key.toLowerCase(), typing = event.target.matches("input");
  if (key === "escape" && (mode === "editing" || mode === "drawing")) drop();
  else if (key === "enter" && canEdit() && !event.target.matches("button")) send();
  else if (typing) return;
  else if (key.startsWith("arrow") && mode === "editing") editor.move(event);
  else if (key === "n" || (key === "arrowright" && mode === "browsing")) step(1);
  else if (key === "p" || (key === "arrowleft" && mode === "browsing")) step(-1);
  else if (key === "r") startDrawing();
  else if (key === "a") add();
  else if (key === "u") undo();
  else return;
  event.preventDefault();
});
at("back").addEventListener("click", () => step(-1));
at("forward").addEventListener("click", () => step(1));
at("draw").addEventListener("click", startDrawing);
at("add").addEventListener("click", add);
at("undo").addEventListener("click", undo);
at("send").addEventListener("click", send);
at("cancel").addEventListener("click", () => decide("/cancel", ""));
seek.addEventListener("input", () => { if (canEdit()) show(seek.valueAsNumber); });

editor.init(() => frame && [frame.width, frame.height]);
const [ok, response] = await request("/recording");
if (ok) {
  const { name, frames, max_targets } = await response.json();
  at("name").textContent = name;
  document.title = `track: draw the targets in ${name}`;
  maxTargets = max_targets;
  at("add").hidden = maxTargets < 2;
  seek.max = Math.max(0, (frames ?? 0) - 1);
}
drop();
show(0);
