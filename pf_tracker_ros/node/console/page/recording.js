// The controls of the recording, if the console plays one.
const at = (id) => document.getElementById(id);
let send, state = null, seeking = false;

export const isOpen = () => state !== null;

export function show(next) {
  state = next;
  const last = Math.max(0, (next.frame_count ?? next.frame + 1) - 1);
  at("recording").hidden = false;
  at("pause-word").textContent = next.playing ? "Pause" : "Play";
  at("seek").max = last;
  if (!seeking) { at("seek").value = next.frame; showFrame(next.frame); }
  at("speed").value = String(next.rate);
  at("save").disabled = !next.can_save;
  at("load").disabled = !next.target_file;
  at("load").title = next.target_file;
  at("problem").hidden = !next.problem;
  if (at("problem").textContent !== next.problem) at("problem").textContent = next.problem;
}

const showFrame = (frame) => { at("frame").textContent = `${Math.max(0, frame)} / ${at("seek").max}`; };

export function toggle() { send({ type: "play", playing: !state.playing }); }
export function step() { send({ type: "step" }); }

function seek(frame) { send({ type: "seek", frame: Math.max(0, frame) }); }

export function init(sender) {
  send = sender;
  at("forward").addEventListener("click", step);
  at("back").addEventListener("click", () => { send({ type: "play", playing: false }); seek(state.frame - 1); });
  at("seek").addEventListener("input", () => { seeking = true; showFrame(at("seek").valueAsNumber); });
  at("seek").addEventListener("change", () => { seeking = false; seek(at("seek").valueAsNumber); });
  at("speed").addEventListener("change", () => send({ type: "rate", rate: Number(at("speed").value) }));
  at("save").addEventListener("click", () => send({ type: "save" }));
  at("load").addEventListener("click", () => send({ type: "load" }));
}
