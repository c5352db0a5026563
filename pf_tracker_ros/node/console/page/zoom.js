// Zoom and pan of the picture: by wheel, pinch, button or key, or dragged with the middle button or with space.
// The view is laid out larger than the stage, so that positions in it are right at any zoom.
const at = (id) => document.getElementById(id);
const stage = at("stage"), view = at("view");
const MOST = 16, STEP = 1.5, MOVE = 0.1;  // largest zoom; factor of a button; share of the stage that an arrow key moves
const LINE = 16;                          // pixels of a wheel that counts lines

let scale = 1, corner = [0, 0];  // the zoom, and the view's top left corner in widths and heights of the stage
const fingers = new Map();       // pointer id to [x, y] of each finger on the picture
let hand = null;                 // last [x, y] of a pointer that pans
let pinching = false;            // until the last finger is lifted
let isSpaceHeld = () => false, cancelDrawing = () => {};

export const isZoomed = () => scale > 1;

// Moves what is at one point of the stage, in its widths and heights, to another, magnified.
function move(from, to, factor = 1) {
  const now = Math.min(MOST, Math.max(1, scale * factor));
  corner = corner.map((start, i) => Math.min(0, Math.max(1 - now, to[i] - (from[i] - start) / scale * now)));
  scale = now;
  const percent = (value) => `${100 * value}%`;
  Object.assign(view.style, { left: percent(corner[0]), top: percent(corner[1]), width: percent(scale), height: percent(scale) });
  at("zoom-fit").textContent = scale === 1 ? "fit" : `${scale.toFixed(1)} x`;
  stage.dataset.zoomed = scale > 1;
}

const zoom = (factor, [x, y] = [0.5, 0.5]) => move([x, y], [x, y], factor);
export const zoomIn = () => zoom(STEP);
export const zoomOut = () => zoom(1 / STEP);
export const fit = () => zoom(1 / MOST);

function place([x, y]) {
  const area = stage.getBoundingClientRect();
  return [(x - area.left) / area.width, (y - area.top) / area.height];
}

function onWheel(event) {
  event.preventDefault();
  // A pinch on a touchpad comes as a wheel with Ctrl, in small steps.
  const pixels = event.deltaY * (event.deltaMode ? LINE : 1);
  zoom(Math.exp(-pixels * (event.ctrlKey ? 0.01 : 0.002)), place([event.clientX, event.clientY]));
}

function pinch() {
  const [[x, y], [u, v]] = [...fingers.values()];
  return { middle: place([(x + u) / 2, (y + v) / 2]), distance: Math.max(1, Math.hypot(u - x, v - y)) };
}

// These run before the handlers of the drawing, which must not see what pans.
function onDown(event) {
  const where = [event.clientX, event.clientY];
  if (event.pointerType === "touch") fingers.set(event.pointerId, where);
  if (fingers.size === 2 && !pinching) { pinching = true; cancelDrawing(); }
  if (event.button === 1 || (!event.button && isSpaceHeld())) hand = where;
  if (!hand && !pinching) return;
  stage.setPointerCapture(event.pointerId);
  event.preventDefault();
  event.stopPropagation();
}

function onMove(event) {
  const where = [event.clientX, event.clientY], before = fingers.size === 2 && pinch();
  if (fingers.has(event.pointerId)) fingers.set(event.pointerId, where);
  if (pinching && before) {
    const after = pinch();
    move(before.middle, after.middle, after.distance / before.distance);
  } else if (hand) {
    move(place(hand), place(where));
    hand = where;
  }
  if (hand || pinching) event.stopPropagation();
}

function onUp(event) {
  fingers.delete(event.pointerId);
  if (hand || pinching) event.stopPropagation();
  hand = null;
  pinching &&= fingers.size > 0;
}

// With one of the buttons focused, the arrow keys move the picture.
function onKey(event) {
  const way = { ArrowLeft: [MOVE, 0], ArrowRight: [-MOVE, 0], ArrowUp: [0, MOVE], ArrowDown: [0, -MOVE] }[event.key];
  if (!way || !isZoomed()) return;
  event.preventDefault();
  event.stopPropagation();
  move([0, 0], way);
}

// Of the given functions, one tells whether the space key is held, the other cancels what a first finger has drawn.
export function init(space, cancel) {
  [isSpaceHeld, cancelDrawing] = [space, cancel];
  view.addEventListener("wheel", onWheel, { passive: false });
  view.addEventListener("pointerdown", onDown, true);
  stage.addEventListener("pointermove", onMove, true);
  for (const kind of ["pointerup", "pointercancel"]) stage.addEventListener(kind, onUp, true);
  // The middle button would scroll.
  view.addEventListener("mousedown", (event) => { if (event.button === 1) event.preventDefault(); });
  at("zoom-in").addEventListener("click", zoomIn);
  at("zoom-out").addEventListener("click", zoomOut);
  at("zoom-fit").addEventListener("click", fit);
  at("zoom").addEventListener("keydown", onKey);
}
