// Editor of a box over a picture: by pointer, touch, keyboard or numbers. The page decides when to edit and
// what to do with the box; it has an svg #overlay with #drawn and #handles, and inputs #box-x to #box-height.
const at = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const overlay = at("overlay"), CLICK = 4, HANDLE = 7, NUMBERS = ["x", "y", "width", "height"];

let sizeOf = () => null;  // [width, height] of the picture, null without one
let drawn = null;         // [x, y, width, height] of the box
let editing = false;      // whether the box has handles
let grip = null;          // pointer position to box, while the pointer is down

export const box = () => drawn;

export function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

export function place(element, box) {
  element.hidden = !box;
  element.toggleAttribute("hidden", !box);
  if (box) set(element, { x: box[0], y: box[1], width: Math.max(0, box[2]), height: Math.max(0, box[3]) });
}

// A rectangle with a text, for the svg.
export function labeledBox() {
  const group = document.createElementNS(SVG, "g");
  group.append(...["rect", "text"].map((name) => document.createElementNS(SVG, name)));
  return group;
}

export function show(box, edited) {
  [drawn, editing] = [box, edited];
  draw();
}

function draw() {
  place(at("drawn"), drawn);
  at("handles").toggleAttribute("hidden", !(drawn && editing));
  if (!drawn) { for (const name of NUMBERS) at(`box-${name}`).value = ""; return; }
  const unit = (sizeOf()?.[0] ?? 1) / (overlay.clientWidth || 1);
  const [x, y, width, height] = drawn;
  const corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]];
  [...at("handles").children].forEach((circle, i) =>
    set(circle, { cx: corners[i][0], cy: corners[i][1], r: HANDLE * unit }));
  NUMBERS.forEach((name, i) => { if (document.activeElement !== at(`box-${name}`)) at(`box-${name}`).value = Math.round(10 * drawn[i]) / 10; });
}

export function point(event) {
  const area = overlay.getBoundingClientRect(), [width, height] = sizeOf();
  return [(event.clientX - area.left) * width / area.width, (event.clientY - area.top) * height / area.height];
}

const span = ([x, y], [u, v]) => [Math.min(x, u), Math.min(y, v), Math.abs(u - x), Math.abs(v - y)];

// Starts to move a corner, to move the box, or to draw a new one, by the place of the pointer.
export function grab(event) {
  overlay.setPointerCapture(event.pointerId);
  const start = point(event), corner = [...at("handles").children].indexOf(event.target);
  if (editing && corner >= 0) {
    const [x, y, width, height] = drawn;
    const opposite = [[x + width, y + height], [x, y + height], [x, y], [x + width, y]][corner];
    grip = (now) => span(opposite, now);
  } else if (editing && event.target === at("drawn")) {
    const box = drawn;
    grip = (now) => [box[0] + now[0] - start[0], box[1] + now[1] - start[1], box[2], box[3]];
  } else {
    grip = (now) => span(start, now);
    grip.start = [event.clientX, event.clientY];
    drawn = [...start, 0, 0];
  }
}

export function drag(event) {
  drawn = grip(point(event));
  draw();
}

// Ends it and returns the box, null for a click.
export function drop(event) {
  const isClick = grip.start && Math.hypot(event.clientX - grip.start[0], event.clientY - grip.start[1]) < CLICK;
  drawn = isClick ? null : grip(point(event)).map((value) => Math.round(value * 100) / 100);
  return drawn;
}

export const centeredBox = ([width, height]) =>
  [(width - width / 4) / 2, (height - height / 4) / 2, width / 4, height / 4].map(Math.round);

export function move(event) {
  const step = event.altKey ? 1 : Math.max(1, Math.round(sizeOf()[0] / 80));
  const [dx, dy] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
  const [x, y, width, height] = drawn;
  drawn = event.shiftKey ? [x, y, Math.max(0, width + dx), Math.max(0, height + dy)] : [x + dx, y + dy, width, height];
  draw();
}

export function init(sizes) {
  sizeOf = sizes;
  for (let i = 0; i < 4; i++) at("handles").append(document.createElementNS(SVG, "circle"));
  NUMBERS.forEach((name, i) => at(`box-${name}`).addEventListener("input", (event) => {
    if (drawn && Number.isFinite(event.target.valueAsNumber)) { drawn = drawn.with(i, event.target.valueAsNumber); draw(); }
  }));
}
