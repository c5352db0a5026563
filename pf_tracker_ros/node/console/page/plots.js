// Line plots of the last minute of status values.
import { fit } from "./children.js";
import { throttle } from "./throttle.js";

const at = (id) => document.getElementById(id);
const SECONDS = 60, WIDTH = 600, HEIGHT = 100;
const SLOT = 0.25;       // seconds per minimum and maximum of a line
const INTERVAL = 500;    // milliseconds between two redraws
const SVG = "http://www.w3.org/2000/svg";

const plots = [
  { id: "confidence", top: () => 1, of: (_, targets) => Object.fromEntries(targets.map((one) => [one.id, one.confidence])) },
  { id: "effective", top: (highest, values) => values.particles ?? highest, of: (values) => ({ effective: values.effective_sample_size }) },
  { id: "processing", top: (highest) => Math.max(10, highest), of: (values) => ({ processing: values.processing_time_ms }) },
  { id: "weights", top: () => 1, of: (values) => Object.fromEntries(
    Object.entries(values).filter(([key]) => key.startsWith("cue_weight_")).map(([key, value]) => [key.slice(11), value])) },
].map((plot) => ({ ...plot, lines: new Map() }));  // name to [seconds, minimum, maximum] of each slot

export function add(values, targets) {
  const now = performance.now() / 1000;
  for (const { of, lines } of plots) {
    for (const [name, value] of Object.entries(of(values, targets))) {
      if (typeof value === "number") put(lines, name, now, value);
    }
  }
  draw(values);
}

function put(lines, name, now, value) {
  if (!lines.has(name)) lines.set(name, []);
  const line = lines.get(name), slot = line.at(-1);
  if (!slot || now - slot[0] >= SLOT) line.push([now, value, value]);
  else [slot[1], slot[2]] = [Math.min(slot[1], value), Math.max(slot[2], value)];
}

const draw = throttle(INTERVAL, (values) => {
  const now = performance.now() / 1000;
  for (const { id, top, of, lines } of plots) {
    for (const [name, line] of lines) {
      while (line.length && line[0][0] < now - SECONDS) line.shift();
      if (!line.length) lines.delete(name);
    }
    const all = [...lines.values()];
    const highest = top(Math.max(0, ...all.flat().map((slot) => slot[2])), values);
    const paths = fit(at(`plot-${id}`), lines.size, () => document.createElementNS(SVG, "path"));
    all.forEach((line, i) => paths[i].setAttribute("d", path(line, now, highest)));
    if (id === "weights") legend([...lines.keys()].map((name) => [name, of(values)[name]]));
    else at(`top-${id}`).textContent = highest.toFixed(highest < 2 ? 1 : 0);
  }
});

// A gap of a second breaks the line.
function path(line, now, highest) {
  let before = -Infinity;
  return line.map(([time, ...ends]) => {
    const command = time - before > 1 ? "M" : "L";
    before = time;
    const x = (WIDTH * (1 - (now - time) / SECONDS)).toFixed(1);
    const [low, high] = ends.map((value) => (HEIGHT * (1 - Math.min(1, value / highest))).toFixed(1));
    return `${command}${x} ${low}${low === high ? "" : `V${high}`}`;
  }).join("");
}

function legend(cues) {
  const items = fit(at("cues"), cues.length, () => document.createElement("li"));
  cues.forEach(([name, value], i) => { items[i].textContent = `${name.replaceAll("_", " ")} ${typeof value === "number" ? value.toFixed(2) : "–"}`; });
}
