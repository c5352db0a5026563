// The controls of the recording, if the console plays one.
import * as tour from "./tour.js";

const at = (id) => document.getElementById(id);
let send, state = null, seeking = false, loops = false;

export const isOpen = () => state !== null;

export function show(next) {
  const last = Math.max(0, (next.frame_count ?? next.frame + 1) - 1);
  const hasEnded = state?.playing && !next.playing && next.frame === last && next.index === state.index;
  state = next;
  at("recording").hidden = at("files").hidden = false;
  at("pause").hidden = true;
  if (tour.show(next.index)) setLoop(tour.hasSteps());
  at("play-word").textContent = next.playing ? "Pause" : "Play";
  at("play").dataset.playing = next.playing;
  at("seek").max = last;
  if (!seeking) { at("seek").value = next.frame; showFrame(next.frame); }
  at("time").textContent = time(next.seconds);
  at("speed").value = String(next.rate);
  at("save").disabled = !next.can_save;
  at("load").disabled = !next.target_file;
  at("load").title = next.target_file;
  at("problem").hidden = !next.problem;
  if (at("problem").textContent !== next.problem) at("problem").textContent = next.problem;
  if (hasEnded && loops) toggle();
}

const showFrame = (frame) => { at("frame").textContent = `${Math.max(0, frame)} / ${at("seek").max}`; };
const time = (seconds) => `${Math.floor(seconds / 60)}:${(seconds % 60).toFixed(2).padStart(5, "0")}`;

export function toggle() { send({ type: "play", playing: !state.playing }); }
export function step() { send({ type: "step" }); }
export function back() { pauseAt(state.frame - 1); }
export function first() { pauseAt(0); }

function pauseAt(frame) {
  send({ type: "play", playing: false });
  seek(frame);
}

function seek(frame) { send({ type: "seek", frame: Math.max(0, frame) }); }

function setLoop(on) {
  loops = on;
  at("loop").setAttribute("aria-pressed", on);
}

export function init(sender) {
  send = sender;
  at("first").addEventListener("click", first);
  at("back").addEventListener("click", back);
  at("play").addEventListener("click", toggle);
  at("forward").addEventListener("click", step);
  at("loop").addEventListener("click", () => setLoop(!loops));
  at("seek").addEventListener("input", () => { seeking = true; showFrame(at("seek").valueAsNumber); });
  at("seek").addEventListener("change", () => { seeking = false; seek(at("seek").valueAsNumber); });
  at("speed").addEventListener("change", () => send({ type: "rate", rate: Number(at("speed").value) }));
  at("save").addEventListener("click", () => send({ type: "save" }));
  at("load").addEventListener("click", () => send({ type: "load" }));
}
