// The last minute of the tracker's figures, as lines.
const at = (id) => document.getElementById(id);
const SECONDS = 60, WIDTH = 600, HEIGHT = 100, INTERVAL = 250;
const SVG = "http://www.w3.org/2000/svg";

const plots = [
  { id: "confidence", top: () => 1, of: (values, targets) => targets ? Object.fromEntries(targets.map((one) => [one.id, one.confidence])) : { confidence: values.confidence } },
  { id: "effective", top: (most, values) => values.particles ?? most, of: (values) => ({ effective: values.effective_sample_size }) },
  { id: "processing", top: (most) => Math.max(10, most), of: (values) => ({ processing: values.processing_time_ms }) },
  { id: "powers", top: () => 1, of: (values) => Object.fromEntries(
    Object.entries(values).filter(([key]) => key.startsWith("power_")).map(([key, value]) => [key.slice(6), value])) },
];
const past = [];  // [seconds, values, targets if there are several] of the frames of the last minute
let drawn = 0, later = null;

export function add(values, targets) {
  const now = performance.now() / 1000;
  past.push([now, values, targets]);
  while (past[0][0] < now - SECONDS) past.shift();
  if (now - drawn >= INTERVAL / 1000) draw(now);
  // The last figures of a recording that stands still are to be seen, too.
  else later ??= setTimeout(() => draw(performance.now() / 1000), INTERVAL);
}

function draw(now) {
  clearTimeout(later);
  [later, drawn] = [null, now];
  for (const { id, top, of } of plots) {
    const lines = new Map();
    let most = 0;
    for (const [time, values, targets] of past) {
      for (const [name, value] of Object.entries(of(values, targets))) {
        if (typeof value !== "number") continue;
        if (!lines.has(name)) lines.set(name, []);
        lines.get(name).push([time, value]);
        most = Math.max(most, value);
      }
    }
    const highest = top(most, past.at(-1)[1]);
    const svg = at(`plot-${id}`);
    while (svg.children.length > lines.size) svg.lastChild.remove();
    while (svg.children.length < lines.size) svg.append(document.createElementNS(SVG, "path"));
    [...lines.values()].forEach((points, i) => svg.children[i].setAttribute("d", path(points, now, highest)));
    if (id === "powers") legend([...lines.keys()].map((name) => [name, of(past.at(-1)[1])[name]]));
    else at(`top-${id}`).textContent = highest.toFixed(highest < 2 ? 1 : 0);
  }
}

// A gap of a second breaks the line.
function path(points, now, highest) {
  let before = -Infinity;
  return points.map(([time, value]) => {
    const command = time - before > 1 ? "M" : "L";
    before = time;
    const x = WIDTH * (1 - (now - time) / SECONDS), y = HEIGHT * (1 - Math.min(1, value / highest));
    return `${command}${x.toFixed(1)} ${y.toFixed(1)}`;
  }).join("");
}

function legend(cues) {
  const list = at("cues");
  while (list.children.length > cues.length) list.lastChild.remove();
  while (list.children.length < cues.length) list.append(document.createElement("li"));
  cues.forEach(([name, value], i) => { list.children[i].textContent = `${name.replaceAll("_", " ")} ${value?.toFixed(2) ?? "–"}`; });
}
