// Line plots of the last minute of status values.
import { fit } from "./children.js";
import { throttle } from "./throttle.js";

const at = (id) => document.getElementById(id);
const SECONDS = 60, WIDTH = 600, HEIGHT = 100, MARGIN = 9;
const SLOT = 0.25;       // seconds per minimum and maximum of a line
const INTERVAL = 500;    // milliseconds between two redraws
const SHOWN = 0.95;      // share of the processing times that the plot shows whole; a target's first frame takes long
const SVG = "http://www.w3.org/2000/svg";
const percent = (value) => `${Math.round(100 * value)} %`;

const plots = [
  { id: "confidence", top: () => 1, unit: percent, of: (_, targets) => Object.fromEntries(targets.map((one) => [one.id, one.confidence])) },
  { id: "effective", top: (peaks, values) => values.particles ?? peaks.at(-1) ?? 0, of: (values) => ({ effective: values.effective_sample_size }) },
  { id: "processing", unit: (value) => `${value.toFixed(0)} ms`, top: (peaks) => Math.max(10, peaks[Math.floor(SHOWN * (peaks.length - 1))] ?? 0), of: (values) => ({ processing: values.processing_time_ms }) },
  { id: "weights", top: () => 1, unit: percent, of: (values) => Object.fromEntries(
    Object.entries(values).filter(([key]) => key.startsWith("cue_weight_")).map(([key, value]) => [key.slice(11), value])) },
].map((plot) => ({ ...plot, lines: new Map() }));  // name to [seconds, minimum, maximum] of each slot

export function add(values, targets) {
  const now = performance.now() / 1000;
  // Without a target there is nothing to plot.
  for (const { of, lines } of targets.length ? plots : []) {
    for (const [name, value] of Object.entries(of(values, targets))) {
      if (typeof value === "number") put(lines, name, now, value);
    }
  }
  at("axis").classList.toggle("empty", !plots.some(({ lines }) => lines.size));
  draw(values, targets.length > 0);
}

export function clear() {
  at("axis").classList.add("empty");
  for (const { id, lines } of plots) {
    lines.clear();
    at(`plot-${id}`).classList.add("empty");
  }
}

// Only cues with log odds give a probability.
export function setCues(cues) {
  const { about, aboutSimilarity } = at("plot-confidence").dataset, isProbability = cues.some((cue) => cue.endsWith("correlation_response"));
  parts.get("confidence").text.firstChild.data = isProbability ? about : aboutSimilarity;
}

function put(lines, name, now, value) {
  if (!lines.has(name)) lines.set(name, []);
  const line = lines.get(name), slot = line.at(-1);
  if (!slot || now - slot[0] >= SLOT) line.push([now, value, value]);
  else [slot[1], slot[2]] = [Math.min(slot[1], value), Math.max(slot[2], value)];
}

const draw = throttle(INTERVAL, (values, hasTargets) => {
  const now = performance.now() / 1000;
  for (const { id, top, unit, of, lines } of plots) {
    for (const [name, line] of lines) {
      while (line.length && line[0][0] < now - SECONDS) line.shift();
      if (!line.length) lines.delete(name);
    }
    const all = [...lines.values()];
    const highest = top(all.flat().map((slot) => slot[2]).sort((one, other) => one - other), values);
    const { svg, top: label, wait } = parts.get(id);
    at(`plot-${id}`).classList.toggle("empty", !all.some((line) => line.length > 1));
    wait.textContent = all.length ? " Waits for more frames." : hasTargets ? " Waits for a frame with a selected target; a click selects." : " Waits for a target.";
    const paths = fit(svg, lines.size, () => document.createElementNS(SVG, "path"));
    all.forEach((line, i) => paths[i].setAttribute("d", path(line, now, highest)));
    label.textContent = unit ? unit(highest) : highest.toFixed(0);
    if (id === "weights") legend([...lines.keys()].map((name) => [name, of(values)[name]]));
  }
});

// A gap of a second breaks the line.
function path(line, now, highest) {
  let before = -Infinity;
  return line.map(([time, ...ends]) => {
    const command = time - before > 1 ? "M" : "L";
    before = time;
    const x = (WIDTH * (1 - (now - time) / SECONDS)).toFixed(1);
    const [low, high] = ends.map((value) => (MARGIN + (HEIGHT - 2 * MARGIN) * (1 - Math.min(1, value / highest))).toFixed(1));
    return `${command}${x} ${low}${low === high ? "" : `V${high}`}`;
  }).join("");
}

function legend(cues) {
  const items = fit(at("cues"), cues.length, () => document.createElement("li"));
  cues.forEach(([name, value], i) => { items[i].textContent = `${name.replaceAll("_", " ")} ${typeof value === "number" ? percent(value) : "–"}`; });
}

// Until it has a line, a plot says what it is; later on demand.
const parts = new Map(plots.map(({ id }) => {
  const plot = at(`plot-${id}`), { name, about } = plot.dataset;
  const create = (tag, properties = {}) => Object.assign(document.createElement(tag), properties);
  const ask = create("button", { type: "button", className: "ask", textContent: "What is this?", ariaExpanded: false, ariaLabel: `What is this: ${name}?` });
  ask.addEventListener("click", () => { ask.ariaExpanded = plot.classList.toggle("asked"); });
  const head = create("p", { className: "row" }), slot = create("div", { className: "slot" });
  const svg = document.createElementNS(SVG, "svg"), top = create("span");
  const wait = create("em", { textContent: " Waits for a target." }), text = create("p", { className: "quiet" });
  text.append(about, wait);
  for (const [key, value] of Object.entries({ viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": `${name}, the last ${SECONDS} seconds` })) svg.setAttribute(key, value);
  head.append(create("span", { textContent: name }), ask, create("span", { id: `now-${id}`, className: "figure" }));
  slot.append(svg, top, text);
  plot.classList.add("empty");
  plot.append(head, slot);
  return [id, { svg, top, text, wait }];
}));
