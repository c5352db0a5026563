// The targets and the detections: thin boxes over the picture where there may be several, and a list to
// select and stop each target.
const SVG = "http://www.w3.org/2000/svg", TEXT = 14;
const at = (id) => document.getElementById(id);
const DETECTED = 1000;   // milliseconds for which a detection is shown
const rows = new Map();    // id to the parts of its row
const colors = new Map();  // id to the tracker's color for it
let send, most = 1, detected = null;

const title = ({ id, label }) => label ? `${id} ${label}` : id;

// As many children as there are things, each made once.
function fit(parent, count, make) {
  while (parent.children.length > count) parent.lastChild.remove();
  while (parent.children.length < count) parent.append(make());
  return [...parent.children];
}

function labeledBox() {
  const group = document.createElementNS(SVG, "g");
  group.append(document.createElementNS(SVG, "rect"), document.createElementNS(SVG, "text"));
  return group;
}

function draw(parent, boxes, unit) {
  fit(parent, boxes.length, labeledBox).forEach((group, i) => {
    const [rect, text] = group.children, { box: [x, y, width, height], stroke, state, words } = boxes[i];
    for (const [name, value] of Object.entries({ x, y, width, height })) rect.setAttribute(name, value);
    if (stroke) rect.setAttribute("stroke", stroke);
    rect.dataset.state = state ?? "";
    text.setAttribute("x", x);
    text.setAttribute("y", Math.max(TEXT * unit, y - 4 * unit));
    text.setAttribute("font-size", TEXT * unit);
    text.textContent = words;
  });
}

const milliseconds = (stamp) => Number(BigInt(stamp) / 1000000n);

// The unit is a pixel of the screen, in those of the image.
export function show(frame, unit) {
  const boxes = frame.boxes ?? {}, found = frame.status?.targets ?? [];
  for (const [id, { color }] of Object.entries(boxes)) colors.set(id, color);
  draw(at("targets"), found.filter(({ id }) => boxes[id] && most > 1).map((one) =>
    ({ box: boxes[one.id].box, stroke: boxes[one.id].color, state: one.state, words: title(one) })), unit);
  const isNew = detected && Math.abs(milliseconds(frame.stamp) - milliseconds(detected.stamp)) < DETECTED;
  draw(at("detections"), (isNew ? detected.boxes : []).map(({ box, label }) => ({ box, words: label })), unit);
  list(found, frame.status?.selected);
}

// Whether a click says which of them is meant.
export const isMultiTarget = () => most > 1;

// The id of the smallest box around a point [x, y], "" where there is none.
export function idAt(frame, [u, v]) {
  const around = Object.entries(frame.boxes ?? {}).filter(([, { box: [x, y, width, height] }]) =>
    x <= u && u < x + width && y <= v && v < y + height);
  const area = ([, { box }]) => box[2] * box[3];
  return around.sort((one, other) => area(one) - area(other))[0]?.[0] ?? "";
}

// Selects a target, or with the one that is selected none.
export const select = (id, selected) => send({ type: "select", id: id === selected ? "0" : id || "0" });

export function setDetections(message) { detected = message; }

function list(found, selected) {
  const ids = new Set(found.map(({ id }) => id));
  for (const [id, { row }] of rows) if (!ids.has(id)) { row.remove(); rows.delete(id); }
  for (const one of found) {
    if (!rows.has(one.id)) add(one.id);
    const { mark, choose, stop } = rows.get(one.id);
    mark.style.background = colors.get(one.id) ?? "";
    const words = `${title(one)} · ${one.state}${typeof one.confidence === "number" ? ` ${one.confidence.toFixed(2)}` : ""}`;
    if (choose.textContent !== words) choose.textContent = words;
    choose.setAttribute("aria-pressed", one.id === selected);
    choose.onclick = () => select(one.id, selected);
    stop.ariaLabel = `Stop ${title(one)}`;
  }
  at("target-count").textContent = `${found.length} of ${most}`;
}

function add(id) {
  const [row, mark, choose, stop] = ["li", "i", "button", "button"].map((name) => document.createElement(name));
  Object.assign(stop, { type: "button", textContent: "Stop", onclick() { send({ type: "stop_target", id }); } });
  Object.assign(choose, { type: "button", className: "choose", title: "Selects the target" });
  row.append(mark, choose, stop);
  row.dataset.id = id;
  const list = at("target-list"), isAfter = ({ dataset }) => Number(dataset.id) > Number(id);
  list.insertBefore(row, [...list.children].find(isAfter) ?? null);  // by their ids
  rows.set(id, { row, mark, choose, stop });
}

// Whether there is room for more than one decides whether the list is there.
export function setMaxTargets(count) {
  most = count;
  at("targets-card").hidden = most < 2;
}

export function init(sender) { send = sender; }
