// The likelihood around the target as a heat map, on demand, and the response of each cue as bars.
import { fit } from "./children.js";

const at = (id) => document.getElementById(id);
const canvas = at("heatmap"), context = canvas.getContext("2d");
let send, on = false;

export function show(frame) {
  const { likelihood, status, width, height } = frame, values = status?.values ?? {};
  const known = on && likelihood && typeof values.likelihood_side === "number";
  canvas.hidden = !known;
  if (!known) { at("bars").replaceChildren(); return; }
  const levels = Uint8Array.from(atob(likelihood.values), (letter) => letter.charCodeAt(0));
  canvas.width = likelihood.columns;
  canvas.height = levels.length / likelihood.columns;
  const pixels = context.createImageData(canvas.width, canvas.height);
  levels.forEach((value, i) => pixels.data.set([255, value, 0, value], 4 * i));
  context.putImageData(pixels, 0, 0);
  const share = (part, whole) => `${100 * part / whole}%`;
  Object.assign(canvas.style, {
    left: share(values.likelihood_x, width), top: share(values.likelihood_y, height),
    width: share(values.likelihood_side, width), height: share(values.likelihood_side, height),
  });
  bars(values);
}

// Likelihood of each cue, raised to its weight, at the target and at the second peak, relative to the larger.
function bars(values) {
  const names = Object.keys(values).filter((key) => key.startsWith("at_target_")).map((key) => key.slice(10));
  const rows = fit(at("bars"), names.length, () => {
    const row = document.createElement("li");
    row.append(document.createElement("span"), ...["target", "second peak"].map((label) =>
      Object.assign(document.createElement("meter"), { max: 1, ariaLabel: label })));
    return row;
  });
  names.forEach((name, i) => {
    const both = [values[`at_target_${name}`], values[`at_second_peak_${name}`]], highest = Math.max(...both);
    const [label, ...meters] = rows[i].children;
    const shares = both.map((value) => Math.exp((values[`cue_weight_${name}`] ?? 1) * (value - highest)));
    label.textContent = `${name.replaceAll("_", " ")}: target ${shares[0].toFixed(2)}, second peak ${shares[1].toFixed(2)}`;
    meters.forEach((meter, j) => { meter.value = shares[j]; });
  });
}

export function request() { if (on) send({ type: "heatmap", shown: true }); }

export function toggle() {
  on = !on;
  at("heatmap-button").setAttribute("aria-pressed", on);
  at("peaks").hidden = !on;
  at("about").textContent = at("heatmap-button").dataset.about;
  canvas.hidden = true;
  send({ type: "heatmap", shown: on });
}

export function init(sender) {
  send = sender;
  at("heatmap-button").addEventListener("click", toggle);
}
