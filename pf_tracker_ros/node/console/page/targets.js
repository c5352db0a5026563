// Several targets and the detections: thin boxes over the picture, and a list with a stop for each target.
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
  draw(at("targets"), found.filter(({ id }) => boxes[id]).map((one) =>
    ({ box: boxes[one.id].box, stroke: boxes[one.id].color, state: one.state, words: title(one) })), unit);
  const isNew = detected && Math.abs(milliseconds(frame.stamp) - milliseconds(detected.stamp)) < DETECTED;
  draw(at("detections"), (isNew ? detected.boxes : []).map(({ box, label }) => ({ box, words: label })), unit);
  list(found);
}

export function detect(message) { detected = message; }

function list(found) {
  const ids = new Set(found.map(({ id }) => id));
  for (const [id, { row }] of rows) if (!ids.has(id)) { row.remove(); rows.delete(id); }
  for (const one of found) {
    if (!rows.has(one.id)) add(one.id);
    const { mark, text, stop } = rows.get(one.id);
    mark.style.background = colors.get(one.id) ?? "";
    const words = `${title(one)} · ${one.state}${typeof one.confidence === "number" ? ` ${one.confidence.toFixed(2)}` : ""}`;
    if (text.textContent !== words) text.textContent = words;
    stop.ariaLabel = `Stop ${title(one)}`;
  }
  at("target-count").textContent = `${found.length} of ${most}`;
}

function add(id) {
  const [row, mark, text, stop] = ["li", "i", "span", "button"].map((name) => document.createElement(name));
  Object.assign(stop, { type: "button", textContent: "Stop", onclick() { send({ type: "stop_target", id }); } });
  row.append(mark, text, stop);
  row.dataset.id = id;
  const list = at("target-list"), isAfter = ({ dataset }) => Number(dataset.id) > Number(id);
  list.insertBefore(row, [...list.children].find(isAfter) ?? null);  // by their ids
  rows.set(id, { row, mark, text, stop });
}

// Whether there is room for more than one decides whether the list is there.
export function allow(count) {
  most = count;
  at("targets-card").hidden = most < 2;
  document.body.classList.toggle("several", most > 1);  // what there is of one target alone goes
  at("heat-button").disabled = most > 1;  // there is one likelihood for one target
  at("heat-button").title = most > 1 ? "with one target alone (max_targets 1)" : "";
}

export function begin(sender) { send = sender; }
