// The tracker's parameters: an input for each, by its type and range.
const at = (id) => document.getElementById(id);
let send;
let structure = "";        // the parameters without their values, as JSON
let typing = false;        // unfinished input is kept
let waiting = null;        // parameters received meanwhile
const fields = new Map();  // name to { row, show, refusal, reset, input }

function element(tag, properties = {}, ...children) {
  const created = Object.assign(document.createElement(tag), properties);
  created.append(...children);
  return created;
}

export function show(parameters) {
  if (typing) {
    waiting = parameters;
    return;
  }
  document.getElementById("yaml").hidden = !parameters.length;
  const now = JSON.stringify(parameters.map(({ value, ...rest }) => rest));
  if (now !== structure) build(parameters);
  structure = now;
  for (const one of parameters) {
    const field = fields.get(one.name);
    field.show(one.value);
    const changed = one.default !== null && JSON.stringify(one.value) !== JSON.stringify(one.default);
    field.row.classList.toggle("changed", changed);
    field.reset.disabled = !changed || one.read_only;
    // A refused value has been replaced by the present one.
    if (document.activeElement !== field.input) showRefusal(one.name, "");
  }
  for (const details of at("groups").querySelectorAll("details")) {
    const changed = details.querySelectorAll(".changed").length;
    details.querySelector("summary span").textContent = changed ? `${changed} changed` : "";
  }
}

export function showRefusal(name, refusal) {
  const field = fields.get(name);
  if (!field) return;
  field.refusal.textContent = refusal;
  if (refusal) { field.input.setAttribute("aria-invalid", "true"); field.reset.disabled = false; }
  else field.input.removeAttribute("aria-invalid");
}

function build(parameters) {
  const open = new Set([...at("groups").querySelectorAll("details[open]")].map((details) => details.dataset.group));
  const focused = document.activeElement?.id;
  fields.clear();
  const groups = Map.groupBy(parameters, (one) => one.group);
  at("groups").replaceChildren(...[...groups].map(([group, members]) => {
    const details = element("details", { open: open.has(group) },
      element("summary", {}, `${group} `, element("span", { className: "quiet" })),
      element("div", { className: "fields" }, ...members.map(row)));
    details.dataset.group = group;
    return details;
  }));
  if (at("find").value) find();
  if (focused) at(focused)?.focus();
}

function row(one) {
  const id = `parameter-${one.name}`;
  const refusal = element("p", { className: "refusal", id: `${id}-refusal`, role: "alert" });
  const submit = (value) => { refusal.textContent = ""; send({ type: "set", name: one.name, value }); };
  const { inputs, show } = makers[kindOf(one)](one, submit);
  inputs[0].id = id;
  for (const input of inputs) {
    input.setAttribute("aria-describedby", `${id}-about ${refusal.id}`);
    input.disabled = one.read_only;
  }
  const allowed = one.range ? `${one.range[0]} to ${one.range[1]}` : one.constraints.replace(/^allowed: /, "");
  const reset = element("button", { type: "button", className: "reset", textContent: "Reset", ariaLabel: `Reset ${one.name}`, onclick() {
    inputs[0].focus();  // the button is going to be disabled
    submit(one.default);
  } });
  const about = element("button", { type: "button", className: "about", textContent: "?", ariaExpanded: false, ariaLabel: `What is ${one.name}?`, title: one.description, onclick() {
    about.ariaExpanded = entry.classList.toggle("asked");
  } });
  const entry = element("div", { className: "parameter" },
    element("label", { htmlFor: id, textContent: one.name }), " ", about,
    element("div", { className: "field" }, ...inputs.map((input) => input.choice ? element("label", { className: "choice" }, input, input.choice) : input), reset),
    element("p", { className: "quiet", id: `${id}-about`, textContent: `${one.description} Allowed: ${allowed}.${one.read_only ? " Read-only while the node runs." : ""}` }),
    refusal);
  entry.dataset.words = `${one.name} ${one.description}`.toLowerCase();
  fields.set(one.name, { row: entry, show, refusal, reset, input: inputs[0] });
  return entry;
}

function kindOf({ kind, choices }) {
  if (kind === "text" && choices.length) return "choice";
  return kind === "texts" && !choices.length ? "words" : kind;
}

// A slider of a wide range has a finer scale near the lower end.
const bend = ([low, high]) => high - low > 20 ? 3 : 1;
const toValue = (place, range) => range[0] + (range[1] - range[0]) * place ** bend(range);
const toPlace = (value, range) => Math.max(0, (value - range[0]) / (range[1] - range[0])) ** (1 / bend(range));
const numberOf = (text) => text.trim() !== "" && Number.isFinite(Number(text)) ? Number(text) : text;

function numeric(one, submit) {
  const input = element("input", { type: "number", step: "any" });
  const slider = element("input", { type: "range", min: 0, max: 1, step: 0.001, tabIndex: -1 });
  slider.setAttribute("aria-hidden", "true");  // the field beside it has the same value
  // The field is narrow; its title has all digits.
  const text = (value) => String(one.kind === "int" ? value : Number(value.toPrecision(6)));
  const digits = (value) => one.kind === "int" ? Math.round(value) : Number(value.toPrecision(3));
  input.onchange = () => submit(numberOf(input.value));
  slider.oninput = () => { input.value = digits(toValue(slider.valueAsNumber, one.range)); };
  slider.onchange = () => submit(input.valueAsNumber);
  return {
    inputs: one.range ? [input, slider] : [input],
    show(value) {
      if (document.activeElement !== input || !input.matches("[aria-invalid]")) [input.value, input.title] = [text(value), value];
      if (one.range) slider.value = toPlace(value, one.range);
    },
  };
}

const makers = {
  int: numeric,
  float: numeric,
  bool(one, submit) {
    const input = element("input", { type: "checkbox", onchange: () => submit(input.checked) });
    return { inputs: [input], show(value) { input.checked = value; } };
  },
  text(one, submit) {
    const input = element("input", { onchange: () => submit(input.value) });
    return { inputs: [input], show(value) { input.value = value; } };
  },
  choice(one, submit) {
    const input = element("select", { onchange: () => submit(input.value) },
      ...one.choices.map((choice) => element("option", { value: choice, textContent: choice })));
    return { inputs: [input], show(value) { input.value = value; } };
  },
  numbers(one, submit) {
    const input = element("input", { onchange() {
      const values = input.value.replace(/[[\]]/g, "").split(",").filter((part) => part.trim()).map(numberOf);
      submit(values.every((value) => typeof value === "number") ? values : input.value);
    } });
    return { inputs: [input], show(value) { input.value = value.join(", "); } };
  },
  words(one, submit) {
    const input = element("input", { onchange: () => submit(input.value.split(",").map((word) => word.trim()).filter(Boolean)) });
    return { inputs: [input], show(value) { input.value = value.join(", "); } };
  },
  texts(one, submit) {
    let order = [];
    const boxes = one.choices.map((choice) => element("input", { type: "checkbox", choice, onchange() {
      submit(this.checked ? [...order, choice] : order.filter((name) => name !== choice));
    } }));
    return { inputs: boxes, show(value) { order = value; for (const box of boxes) box.checked = value.includes(box.choice); } };
  },
};

function endTyping() {
  typing = false;
  if (waiting) show(waiting);
  waiting = null;
}

// Shows the parameters with all words of the search, and opens their groups.
function find() {
  const words = at("find").value.toLowerCase().split(/\s+/).filter(Boolean);
  for (const details of at("groups").querySelectorAll("details")) {
    const rows = [...details.querySelectorAll(".parameter")];
    for (const row of rows) row.hidden = !words.every((word) => row.dataset.words.includes(word));
    details.hidden = rows.every((row) => row.hidden);
    details.open = words.length > 0 && !details.hidden;
  }
  at("unfound").hidden = !fields.size || [...fields.values()].some(({ row }) => !row.hidden);
  at("unfound").textContent = `no parameter has "${at("find").value.trim()}" in its name or description`;
}

export function init(sender) {
  send = sender;
  at("groups").addEventListener("input", () => { typing = true; });
  at("find").addEventListener("input", find);
  // The handlers of the fields themselves run first.
  for (const kind of ["change", "focusout"]) at("groups").addEventListener(kind, endTyping);
  at("reset").addEventListener("click", () => send({ type: "reset" }));
}
