// The boxes of targets and detections over the picture, and a list to select and stop each target.
// With a single target neither its thin box nor the list is shown.
import { labeledBox, set } from "./box_editor.js";
import { fit } from "./children.js";
import { showDetections } from "./legend.js";
import * as timeline from "./timeline.js";

const TEXT = 14;
const at = (id) => document.getElementById(id);
const DETECTED = 1000;   // milliseconds for which detections are shown
const rows = new Map();    // id to the elements of its row
const colors = new Map();  // id to the color that the tracker gave it
let send, showNewest, maxTargets = 1, count = 0, isBuiltIn = false, detected = null;
let chosen = null;         // id of the target selected since the newest frame, "" for none, and the frame's stamp

const title = ({ id, label }) => label ? `${id} ${label}` : id;

const COVERED = 0.3;     // share of a box that another one covers, to be in front of it

// Share of one box that another covers.
function coveredShare([x, y, width, height], [u, v, w, h]) {
  const across = Math.min(x + width, u + w) - Math.max(x, u), down = Math.min(y + height, v + h) - Math.max(y, v);
  return Math.max(0, across) * Math.max(0, down) / (width * height);
}

// Why a target is occluded or lost, in words; "" while it is tracked.
export function reason(one, { boxes = {}, status, width, height }) {
  if (one.state === "lost") return "not seen any more";
  const own = boxes?.[one.id]?.box;
  if (one.state !== "occluded" || !own) return "";
  const front = status.targets.find((other) => other.id !== one.id && other.state === "tracking" && boxes[other.id]
    && coveredShare(own, boxes[other.id].box) > COVERED);
  if (front) return `behind ${title(front)}`;
  const [x, y, across, down] = own;
  if (x < 0 || y < 0 || x + across > width || y + down > height) return "at the edge of the picture";
  return one.confidence >= 0.5 ? "not certain yet: just found again, or a similar object is near" : "hardly seen";
}

// Id, state, confidence, and why it is out of sight.
function inWords(one, frame) {
  const why = reason(one, frame);
  return `${title(one)} · ${one.state}${typeof one.confidence === "number" ? ` ${Math.round(100 * one.confidence)} %` : ""}${why ? `, ${why}` : ""}`;
}

// The targets of a frame for the timeline, the selected one first.
export function describe(frame) {
  const { targets, selected } = frame.status;
  return targets.map((one) => ({ ...one, color: frame.boxes?.[one.id]?.color ?? colors.get(one.id), words: inWords(one, frame) }))
    .sort((one, other) => (other.id === selected) - (one.id === selected));
}

// The labels, without covering each other: one that would goes up, or, at the edge, below its box.
function placeLabels(boxes, unit, frame) {
  const taken = [];
  return boxes.map(({ box: [left, y, , height], caption }) => {
    const size = TEXT * unit, across = 0.62 * size * caption.length;
    const x = Math.max(0, Math.min(left, frame.width - across));
    const isTaken = (top) => taken.some((other) => x < other.x + other.across && other.x < x + across && Math.abs(top - other.top) < size);
    let top = Math.max(size, y - 4 * unit);
    while (isTaken(top) && top > size) top = Math.max(size, top - size);
    if (isTaken(top)) top = y + height + size;
    top = Math.min(top, frame.height - unit);
    taken.push({ x, across, top });
    return { x, y: top };
  });
}

function draw(parent, boxes, unit, frame) {
  const places = placeLabels(boxes, unit, frame);
  fit(parent, boxes.length, labeledBox).forEach((group, i) => {
    const [rect, text] = group.children, { box: [x, y, width, height], stroke, state, caption } = boxes[i];
    set(rect, { x, y, width, height });
    if (stroke) rect.setAttribute("stroke", stroke);
    rect.dataset.state = state ?? "";
    set(text, { ...places[i], "font-size": TEXT * unit });
    text.textContent = caption;
  });
}

const milliseconds = (stamp) => Number(BigInt(stamp) / 1000000n);

// The unit is the size of a screen pixel in image pixels.
export function show(frame, unit) {
  const boxes = frame.boxes ?? {}, found = frame.status?.targets ?? [];
  for (const [id, { color }] of Object.entries(boxes)) colors.set(id, color);
  draw(at("targets"), found.filter(({ id }) => boxes[id] && maxTargets > 1).map((one) =>
    ({ box: boxes[one.id].box, stroke: boxes[one.id].color, state: one.state, caption: title(one) })), unit, frame);
  const isNew = detected && Math.abs(milliseconds(frame.stamp) - milliseconds(detected.stamp)) < DETECTED;
  draw(at("detections"), (isNew ? detected.boxes : []).map(({ box, label }) => ({ box, caption: label })), unit, frame);
  if (isNew) showDetections();
  // A late tracker leaves pictures without a status: the list stays.
  if (frame.status) list(found, frame);
}

// Whether a click selects a target instead of starting one.
export const isMultiTarget = () => maxTargets > 1;

// The id of the smallest box around a point [x, y], "" where there is none.
export function idAt(frame, [u, v]) {
  const around = Object.entries(frame.boxes ?? {}).filter(([, { box: [x, y, width, height] }]) =>
    x <= u && u < x + width && y <= v && v < y + height);
  const area = ([, { box }]) => box[2] * box[3];
  return around.sort((one, other) => area(one) - area(other))[0]?.[0] ?? "";
}

// Selects a target; deselects it if it is selected.
export function select(id, selected) {
  const next = id === selected ? "" : id;
  if (!send({ type: "select", id: next || "0" })) return;
  chosen = { id: next, stamp: timeline.last()?.stamp };
  showNewest();
}

// The newest frame with the target selected since. What it has of another target alone is left out.
export function withChoice(frame) {
  if (chosen?.stamp !== frame.stamp || !frame.status) { chosen = null; return frame; }
  const { targets, values } = frame.status, own = targets.find(({ id }) => id === chosen.id);
  const state = own?.state ?? ["tracking", "occluded", "lost"].find((one) => targets.some((target) => target.state === one));
  const known = { state, confidence: own?.confidence, processing_time_ms: values.processing_time_ms };
  return { ...frame, likelihood: null, status: { ...frame.status, selected: chosen.id, values: known } };
}

export function setDetections(message) { detected = message; }

export function setDetector(now) { isBuiltIn = now; }

// Whether targets start by themselves, so that nobody has to draw.
export const hasDetector = () => isBuiltIn || Boolean(detected);

function list(found, frame) {
  const selected = frame.status?.selected;
  const ids = new Set(found.map(({ id }) => id));
  for (const [id, { row }] of rows) if (!ids.has(id)) { row.remove(); rows.delete(id); }
  for (const one of found) {
    if (!rows.has(one.id)) add(one.id);
    const { mark, choose, stop } = rows.get(one.id);
    mark.style.background = colors.get(one.id) ?? "";
    const caption = inWords(one, frame);
    if (choose.textContent !== caption) choose.textContent = caption;
    choose.setAttribute("aria-pressed", one.id === selected);
    choose.onclick = () => select(one.id, selected);
    stop.ariaLabel = `Stop ${title(one)}`;
  }
  count = found.length;
  showCount();
}

export function clear() { list([], {}); }

function showCount() { at("target-count").textContent = `${count} of ${maxTargets}`; }

function add(id) {
  const [row, mark, choose, stop] = ["li", "i", "button", "button"].map((name) => document.createElement(name));
  Object.assign(stop, { type: "button", textContent: "Stop", onclick() { send({ type: "stop_target", id }); } });
  Object.assign(choose, { type: "button", className: "choose", title: "Selects the target" });
  row.append(mark, choose, stop);
  row.dataset.id = id;
  const list = at("target-list"), isAfter = ({ dataset }) => Number(dataset.id) > Number(id);
  list.insertBefore(row, [...list.children].find(isAfter) ?? null);  // sorted by id
  rows.set(id, { row, mark, choose, stop });
}

export function setMaxTargets(most) {
  maxTargets = most;
  showCount();
  at("targets-card").hidden = maxTargets < 2;
}

export function init(sender, newest) { [send, showNewest] = [sender, newest]; }
