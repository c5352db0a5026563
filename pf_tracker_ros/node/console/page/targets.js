// The boxes of targets and detections over the picture, and a list to select and stop each target.
// With a single target neither its thin box nor the list is shown.
import { labeledBox, set } from "./box_editor.js";
import { fit } from "./children.js";
import { showDetections } from "./legend.js";

const TEXT = 14;
const at = (id) => document.getElementById(id);
const DETECTED = 1000;   // milliseconds for which detections are shown
const rows = new Map();    // id to the elements of its row
const colors = new Map();  // id to the color that the tracker gave it
let send, maxTargets = 1, detected = null;

const title = ({ id, label }) => label ? `${id} ${label}` : id;

function draw(parent, boxes, unit) {
  fit(parent, boxes.length, labeledBox).forEach((group, i) => {
    const [rect, text] = group.children, { box: [x, y, width, height], stroke, state, caption } = boxes[i];
    set(rect, { x, y, width, height });
    if (stroke) rect.setAttribute("stroke", stroke);
    rect.dataset.state = state ?? "";
    set(text, { x, y: Math.max(TEXT * unit, y - 4 * unit), "font-size": TEXT * unit });
    text.textContent = caption;
  });
}

const milliseconds = (stamp) => Number(BigInt(stamp) / 1000000n);

// The unit is the size of a screen pixel in image pixels.
export function show(frame, unit) {
  const boxes = frame.boxes ?? {}, found = frame.status?.targets ?? [];
  for (const [id, { color }] of Object.entries(boxes)) colors.set(id, color);
  draw(at("targets"), found.filter(({ id }) => boxes[id] && maxTargets > 1).map((one) =>
    ({ box: boxes[one.id].box, stroke: boxes[one.id].color, state: one.state, caption: title(one) })), unit);
  const isNew = detected && Math.abs(milliseconds(frame.stamp) - milliseconds(detected.stamp)) < DETECTED;
  draw(at("detections"), (isNew ? detected.boxes : []).map(({ box, label }) => ({ box, caption: label })), unit);
  if (isNew) showDetections();
  list(found, frame.status?.selected);
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
export const select = (id, selected) => send({ type: "select", id: id === selected ? "0" : id || "0" });

export function setDetections(message) { detected = message; }

function list(found, selected) {
  const ids = new Set(found.map(({ id }) => id));
  for (const [id, { row }] of rows) if (!ids.has(id)) { row.remove(); rows.delete(id); }
  for (const one of found) {
    if (!rows.has(one.id)) add(one.id);
    const { mark, choose, stop } = rows.get(one.id);
    mark.style.background = colors.get(one.id) ?? "";
    const caption = `${title(one)} · ${one.state}${typeof one.confidence === "number" ? ` ${Math.round(100 * one.confidence)} %` : ""}`;
    if (choose.textContent !== caption) choose.textContent = caption;
    choose.setAttribute("aria-pressed", one.id === selected);
    choose.onclick = () => select(one.id, selected);
    stop.ariaLabel = `Stop ${title(one)}`;
  }
  at("target-count").textContent = `${found.length} of ${maxTargets}`;
}

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

export function setMaxTargets(count) {
  maxTargets = count;
  at("targets-card").hidden = maxTargets < 2;
}

export function init(sender) { send = sender; }
