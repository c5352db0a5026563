// The list of recordings, and the tour: what to try with each of them, step by step.
import { fit } from "./children.js";
import * as plots from "./plots.js";
import * as stage from "./stage.js";

const at = (id) => document.getElementById(id);
let send, list = [], shown = null;
let opening = null;  // index of the recording that this page has asked for
let step = 0;

export function setRecordings(recordings) {
  list = recordings;
  at("tour").hidden = list.length < 2 && !list.some(({ steps }) => steps.length);
  const buttons = fit(at("choices"), list.length, () => Object.assign(document.createElement("button"), { type: "button" }));
  list.forEach(({ title }, i) => Object.assign(buttons[i], { textContent: title, onclick: () => open(i) }));
  if (shown !== null) draw();
}

// The recording that is played; returns whether it has just been opened.
export function show(index) {
  if (index === shown && index !== opening) return false;
  [shown, step] = [index, 0];
  draw();
  plots.clear();
  const { target, steps } = list[index] ?? { target: null, steps: [] };
  stage.begin(target, Boolean(target) || !steps.length);
  if (index === opening) {
    set(list[index].parameters);
    opening = null;
  }
  return true;
}

export const hasSteps = () => Boolean(list[shown]?.steps.length);

function open(index) {
  opening = index;
  send({ type: "open", index });
}

function set(parameters) {
  for (const [name, value] of Object.entries(parameters)) send({ type: "set", name, value });
}

function draw() {
  [...at("choices").children].forEach((button, i) => button.setAttribute("aria-pressed", i === shown));
  const { steps } = list[shown] ?? { steps: [] }, following = list[shown + 1];
  at("steps").hidden = !steps.length;
  if (!steps.length) return;
  const { text, parameters } = steps[step], isLast = step === steps.length - 1;
  at("step").replaceChildren(text);
  const values = Object.entries(parameters);
  if (values.length) {
    const button = Object.assign(document.createElement("button"), {
      type: "button",
      textContent: `Set ${values.map(([name, value]) => `${name} to ${value}`).join(", ")}`,
      onclick() { set(parameters); },
    });
    at("step").append(" ", button);
  }
  at("step-count").textContent = `${step + 1} of ${steps.length}`;
  at("step-back").disabled = !step;
  at("step-next").disabled = isLast && !following;
  at("step-next").textContent = isLast && following ? `Next: ${following.title}` : "Next";
}

function move(by) {
  if (list[shown].steps[step + by]) { step += by; draw(); }
  else open(shown + 1);
}

export function init(sender) {
  send = sender;
  at("step-back").addEventListener("click", () => move(-1));
  at("step-next").addEventListener("click", () => move(1));
}
