// The states of the targets over a recording, or over the last minutes of a camera, and the frames to look back at.
import { throttle } from "./throttle.js";

const at = (id) => document.getElementById(id);
const bar = at("timeline"), canvas = at("states"), context = canvas.getContext("2d");
const CAMERA_WINDOW = 120000, GAP = 1000;  // milliseconds of a camera that are kept; a longer gap is left blank
const MOST = 20000, MOST_BYTES = 64e6;     // moments, and bytes of their frames
const ROWS = 8, LINE_ROW = 9;              // most targets that are drawn; pixels of a row that has a line
const INTERVAL = 400;                      // milliseconds between two redraws
const PAGE = 25;                           // moments of the page keys
const NEAR = 3;                            // pixels to the next moment that a click still means
const COLORS = { tracking: "--ok", occluded: "--warn", lost: "--error" };

// Of each frame with a status: stamp, position (frame of the recording, or milliseconds), time, targets, and the message
// with the frame, null once it is dropped.
let moments = [];
let bytes = 0;
let shown = null;        // the moment that is looked at
let frameCount = null, meanInterval = NaN;  // of the recording
let isRecording = false;
let go = () => {};       // looks at a position

export const last = () => moments.at(-1);
export const looked = () => shown;

function forget() { [moments, bytes, shown] = [[], 0, null]; draw(); }

// Another recording is opened.
export function clear() { meanInterval = NaN; forget(); }

// Number of frames, null if unknown, and mean milliseconds between two, NaN if unknown.
export function setRecording(count, interval) {
  meanInterval = interval || meanInterval;
  if (count !== frameCount) { frameCount = count; draw(); }
}

// Targets as { id, state, confidence, color, words }.
export function add(frame, targets, data) {
  const time = Number(BigInt(frame.stamp) / 1000000n), index = frame.index, position = index ?? time;
  if (Number.isInteger(index) !== isRecording) { forget(); isRecording = Number.isInteger(index); }
  // Where time has gone back, later moments are of another run.
  const kept = 1 + moments.findLastIndex((one) => one.position < position);
  for (const gone of moments.splice(kept)) bytes -= gone.data?.byteLength ?? 0;
  moments.push({ stamp: frame.stamp, position, index, time, targets, data });
  bytes += data.byteLength;
  const outdated = isRecording ? moments.length - MOST : moments.findIndex((one) => one.time >= time - CAMERA_WINDOW);
  for (const gone of outdated > 0 ? moments.splice(0, outdated) : []) bytes -= gone.data?.byteLength ?? 0;
  for (const one of moments) {
    if (bytes <= MOST_BYTES) break;
    bytes -= one.data?.byteLength ?? 0;
    one.data = null;
  }
  draw();
}

// The moment before or after a position, with a step of -1 or 1, unless there is a gap; undefined without one.
export function next(position, step) {
  const here = find(position, Infinity), there = moments[moments.indexOf(here) + step];
  return there && Math.abs(there.time - here.time) <= GAP ? there : undefined;
}

// The moment at a position, or the nearest one that is closer than a distance; undefined without one.
export function find(position, within = 0) {
  const nearest = moments.reduce((best, one) => Math.abs(one.position - position) < Math.abs(best.position - position) ? one : best, moments[0] ?? { position: Infinity });
  return Math.abs(nearest.position - position) <= within ? nearest : undefined;
}

export function look(moment) {
  shown = moment;
  draw();
}

// Time and targets of a moment, in words: those that are out of sight one by one.
export function words({ index, time, targets }) {
  const when = isRecording ? `frame ${index}, ${clock(timeOf(index))}` : `${((last().time - time) / 1000).toFixed(1)} s ago`;
  const tracked = targets.filter(({ state }) => state === "tracking"), others = targets.filter(({ state }) => state !== "tracking");
  const those = tracked.length > 1 ? [`${tracked.length} targets tracking`] : tracked.map((one) => one.words);
  return `${when}: ${[...those, ...others.map((one) => one.words)].join("; ") || "no target"}`;
}

const clock = (milliseconds) => `${Math.floor(milliseconds / 60000)}:${(milliseconds / 1000 % 60).toFixed(1).padStart(4, "0")}`;

// Milliseconds of a frame since the first, by the mean interval.
function timeOf(index) {
  const [from, to] = [moments[0], last()], known = to?.index > from?.index ? (to.time - from.time) / (to.index - from.index) : meanInterval;
  return index ? index * known : 0;
}

// First and last position of the axis.
function range() {
  if (isRecording) return [0, Math.max(frameCount ?? 0, (last()?.position ?? 0) + 1)];
  return [(last()?.time ?? 0) - CAMERA_WINDOW, last()?.time ?? 0];
}

const draw = throttle(INTERVAL, () => {
  const scale = devicePixelRatio, [first, end] = range(), style = getComputedStyle(bar);
  const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
  if (!width) return;
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  context.clearRect(0, 0, width, height);
  const x = (position) => width * (position - first) / (end - first);
  const rows = latestTargets(), row = height / (rows.length || 1);
  rows.forEach(([id, color], i) => {
    const runs = runsOf(id);
    for (const { state, from, to } of runs) {
      context.globalAlpha = state === "lost" ? 0.55 : 0.4;
      context.fillStyle = style.getPropertyValue(COLORS[state] ?? "--quiet");
      context.fillRect(x(from), i * row, Math.max(scale, x(to) - x(from)), row - (rows.length > 1 ? scale : 0));
    }
    context.globalAlpha = 1;
    context.strokeStyle = style.color;
    context.lineWidth = 1.2 * scale;
    if (row >= LINE_ROW * scale) for (const { line } of runs) {
      context.beginPath();
      for (const [position, confidence] of line) context.lineTo(x(position), i * row + (row - 3 * scale) * (1 - confidence) + scale);
      context.stroke();
    }
    // The color of its box tells the rows apart.
    if (rows.length > 1 && color) {
      context.fillStyle = color;
      context.fillRect(0, i * row, 4 * scale, row - scale);
    }
  });
  const present = shown ?? last();
  at("playhead").hidden = !present;
  at("states-empty").hidden = moments.some(({ targets }) => targets.length);
  const share = present ? x(present.position + (isRecording ? 0.5 : 0)) / width : 0;
  at("playhead").style.transform = `translateX(${Math.min(1, Math.max(0, share)) * canvas.clientWidth}px)`;
  [...at("ticks").children].forEach((tick, i, { length }) => {
    const share = i / (length - 1), milliseconds = isRecording ? timeOf(share * (end - 1)) : (1 - share) * CAMERA_WINDOW;
    const text = Number.isNaN(milliseconds) ? "" : clock(milliseconds).replace(/\.0$/, "");
    tick.textContent = isRecording ? text : share === 1 ? "now" : `${text} ago`;
  });
  for (const [name, value] of Object.entries({ min: first, max: end - (isRecording ? 1 : 0), now: present?.position ?? first, text: present ? words(present) : "nothing yet" })) bar.setAttribute(`aria-value${name}`, value);
});

// [id, color] of the latest targets, by id.
function latestTargets() {
  const found = new Map();
  for (let i = moments.length - 1; i >= 0 && found.size < ROWS; i--) {
    for (const { id, color } of moments[i].targets) if (found.size < ROWS || found.has(id)) found.set(id, found.get(id) ?? color);
  }
  return [...found].sort(([one], [other]) => one - other);
}

// Stretches of one state of a target, with its confidence at each position.
function runsOf(id) {
  const runs = [];
  let run = null;
  moments.forEach((moment, i) => {
    const one = moment.targets.find((target) => target.id === id), next = moments[i + 1];
    if (run?.state !== one?.state || moment.time - run?.until > GAP) run = one ? { state: one.state, from: moment.position, line: [] } : null;
    if (!run) return;
    if (!run.line.length) runs.push(run);
    const isNear = next && next.time - moment.time <= GAP;
    [run.to, run.until] = [isNear ? next.position : moment.position + (isRecording ? 1 : 0), moment.time];
    if (typeof one.confidence === "number") run.line.push([moment.position, one.confidence]);
  });
  return runs;
}

function pointed({ clientX }) {
  const area = canvas.getBoundingClientRect(), [first, end] = range();
  const position = first + Math.min(1, Math.max(0, (clientX - area.left) / area.width)) * (end - first);
  const near = NEAR * (end - first) / area.width;
  return isRecording ? [Math.min(end - 1, Math.floor(position)), near] : [position, GAP + near];
}

function onKey(event) {
  const here = shown ?? last();
  if (!here || event.altKey || event.ctrlKey || event.metaKey) return;
  const i = moments.indexOf(here), page = (by) => moments[Math.max(0, Math.min(moments.length - 1, i + by))].position;
  const to = {
    ArrowLeft: () => isRecording ? here.position - 1 : moments[i - 1]?.position,
    ArrowRight: () => isRecording ? here.position + 1 : moments[i + 1]?.position,
    PageDown: () => page(-PAGE), PageUp: () => page(PAGE),
    Home: () => moments[0].position, End: () => last().position,
  }[event.key];
  if (!to) return;
  event.preventDefault();
  event.stopPropagation();
  if (to() !== undefined) go(to(), 0);
}

// Looks at a position, or at a moment that is nearer to it than a distance.
export function init(look) {
  go = look;
  let dragged = false;
  bar.addEventListener("pointerdown", (event) => {
    if (event.button || !moments.length) return;
    dragged = true;
    bar.setPointerCapture(event.pointerId);
    go(...pointed(event));
  });
  bar.addEventListener("pointermove", (event) => { if (dragged && find(...pointed(event))) go(...pointed(event)); });
  for (const kind of ["pointerup", "pointercancel"]) bar.addEventListener(kind, () => { dragged = false; });
  bar.addEventListener("keydown", onKey);
  new ResizeObserver(draw).observe(bar);
  draw();
}
