// What is drawn over the picture: each part can be switched off, and tells what it is.
const at = (id) => document.getElementById(id);
const buttons = [...at("legend").querySelectorAll("button")];

function tell({ dataset }) { at("about").textContent = dataset.about; }

function toggle(button) {
  const on = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", on);
  at("stage").dataset.hidden = buttons.filter((one) => one.getAttribute("aria-pressed") === "false").map((one) => one.dataset.layer).join(" ");
}

// The entry of the detections comes with the first ones.
export function showDetections() { buttons.find(({ dataset }) => dataset.layer === "detections").hidden = false; }

export function init() {
  for (const button of buttons) {
    button.ariaDescription = button.dataset.about;
    for (const kind of ["pointerenter", "focus", "click"]) button.addEventListener(kind, () => tell(button));
    // The heat map is requested from the tracker.
    if (button.dataset.layer !== "heat") button.addEventListener("click", () => toggle(button));
  }
}
