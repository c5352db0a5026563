// Several targets and the detections: thin boxes over the picture, and a list with a stop for each target.
const SVG = "http://www.w3.org/2000/svg", TEXT = 14;
const at = (id) => document.getElementById(id);
const rows = new Map();  // id to the parts of its row
let send, most = 1;

// Neighbors in number are far apart in hue.
const color = (id) => `hsl(${(137.5 * [...id].reduce((sum, letter) => 31 * sum % 360 + letter.codePointAt(0), 0)) % 360} 90% 65%)`;
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

export function show(frame) {
  const found = most > 1 ? frame.targets ?? [] : [], unit = frame.width / at("overlay").clientWidth || 1;
  draw(at("targets"), found.filter(({ box }) => box).map((one) =>
    ({ box: one.box, stroke: color(one.id), state: one.state, words: title(one) })), unit);
  draw(at("detections"), (frame.detections ?? []).map(({ box, label }) => ({ box, words: label })), unit);
  list(found);
}

function list(found) {
  const ids = new Set(found.map(({ id }) => id));
  for (const [id, { row }] of rows) if (!ids.has(id)) { row.remove(); rows.delete(id); }
  for (const one of found) {
    if (!rows.has(one.id)) add(one.id);
    const { text, stop } = rows.get(one.id);
    const words = `${title(one)} · ${one.state}${typeof one.confidence === "number" ? ` ${one.confidence.toFixed(2)}` : ""}`;
    if (text.textContent !== words) text.textContent = words;
    stop.ariaLabel = `Stop ${title(one)}`;
  }
  at("target-count").textContent = `${found.length} of ${most}`;
}

function add(id) {
  const [row, mark, text, stop] = ["li", "i", "span", "button"].map((name) => document.createElement(name));
  mark.style.background = color(id);
  Object.assign(stop, { type: "button", textContent: "Stop", onclick() { send({ type: "stop_target", id }); } });
  row.append(mark, text, stop);
  at("target-list").append(row);
  rows.set(id, { row, text, stop });
}

// Whether there is room for more than one decides whether the list is there.
export function allow(count) {
  most = count;
  at("targets-card").hidden = most < 2;
}

export function begin(sender) { send = sender; }
