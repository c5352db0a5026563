// The controls of the recording, if the console plays one.
import * as stage from "./stage.js";
import * as targets from "./targets.js";
import * as timeline from "./timeline.js";
import * as tour from "./tour.js";

const NEAR = 12;  // frames

const at = (id) => document.getElementById(id);
let send, showMoment, state = null, seeking = false, loops = false;

export const isOpen = () => state !== null;
export const isOpening = () => Boolean(state?.opening);
export const isPaused = () => state?.playing === false;

export function show(next) {
  const last = Math.max(0, (next.frame_count ?? next.frame + 1) - 1);
  const hasEnded = state?.playing && !next.playing && next.frame === last && next.index === state.index;
  state = next;
  at("recording").hidden = at("files").hidden = at("again").hidden = false;
  // A recording's stamps are of another clock.
  at("pause").hidden = at("age").parentElement.hidden = true;
  if (tour.show(next.index)) { timeline.clear(); setLoop(tour.hasSteps()); }
  stage.setOpening(next.opening);
  timeline.setRecording(next.frame_count ?? null, 1000 * next.seconds / next.frame);
  at("play-word").textContent = next.playing ? "Pause" : "Play";
  at("play").dataset.playing = next.playing;
  at("seek").max = last;
  showPosition();
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

// The frame that is looked at, or else the newest one.
const frame = () => timeline.looked()?.index ?? state.frame;

// Frame and time of the picture.
export function showPosition() {
  if (!state || seeking) return;
  const moment = timeline.looked(), since = moment ? timeline.last().time - moment.time : 0;
  at("again").textContent = `Track again from here${targets.hasDetector() ? " (forgets detected targets)" : ""}`;
  at("seek").value = frame();
  showFrame(frame());
  at("time").textContent = time(state.seconds - since / 1000);
}

// Plays on from the frame that is looked at.
export function toggle() {
  const playing = Boolean(timeline.looked()) || !state.playing;
  if (timeline.looked()) seek(frame());
  send({ type: "play", playing });
}

export function step() {
  if (timeline.looked()) look(frame() + 1, known(frame() + 1, timeline.next(frame(), 1)));
  else send({ type: "step" });
}

export function back() { look(frame() - 1, known(frame() - 1, timeline.next(frame(), -1))); }

// What the page has of a frame. On a busy machine it lacks some. Those come by a seek, which starts the drawn targets again,
// but none of a detector: then it is the nearest one.
function known(position, nearest) {
  const loses = targets.hasDetector() && timeline.last()?.targets.length;
  return timeline.find(position) ?? (loses ? nearest : undefined);
}

export function first() {
  send({ type: "play", playing: false });
  seek(0);
}

// Shows a frame as it was, if the page still has it; only a seek starts the tracker again.
export function look(position, moment = known(position, timeline.find(position, NEAR))) {
  if (state.playing) send({ type: "play", playing: false });
  if (moment?.index === state.frame) stage.live();
  else if (moment?.data) showMoment(moment);
  else seek(position);
}

function seek(frame) {
  stage.live();
  send({ type: "seek", frame: Math.max(0, frame) });
}

function setLoop(on) {
  loops = on;
  at("loop").setAttribute("aria-pressed", on);
}

export function init(sender, show) {
  [send, showMoment] = [sender, show];
  at("first").addEventListener("click", first);
  at("back").addEventListener("click", back);
  at("play").addEventListener("click", toggle);
  at("again").addEventListener("click", () => seek(frame()));
  at("forward").addEventListener("click", step);
  at("loop").addEventListener("click", () => setLoop(!loops));
  at("seek").addEventListener("input", () => { seeking = true; showFrame(at("seek").valueAsNumber); });
  at("seek").addEventListener("change", () => { seeking = false; seek(at("seek").valueAsNumber); });
  at("speed").addEventListener("change", () => send({ type: "rate", rate: Number(at("speed").value) }));
  at("save").addEventListener("click", () => send({ type: "save" }));
  at("load").addEventListener("click", () => send({ type: "load" }));
}
