// The page: what arrives from the server is put on the stage, what a person does goes to the stage or to the server.

import { inWords, middle } from "./facts.js";
import { gestures } from "./gestures.js";
import { listen } from "./keys.js";
import { createLooks } from "./looks.js";
import { keep, kept } from "./memory.js";
import { picture } from "./pictures.js";
import { degrees, moved, radians, turned } from "./pose.js";
import { createStage } from "./stage.js";
import { said } from "./voice.js";

const TURN_DEG = 0.5; // of one press
const $ = (id) => document.getElementById(id);
const box = $("stage");
const stage = createStage(box, $("maps"), $("marks"), posed);
let shown = null; // the example on the page; ready: its maps can be seen
const speak = said($("said"));
const looks = createLooks(stage, box, {
  chip: $("alone"),
  blinker: $("blink"),
  name: (whose) => shown?.names[whose] ?? null,
  speak: (sentence) => shown?.ready && speak(sentence),
});
const left = new Map(); // n → what was on the page when it was answered, for undo
let viewMode = false;
let [acted, asked] = [0, 0]; // when a key or button was pressed last; when one that asks the server was
let judged = null; // the example whose answer was saved, until it is told what the robot had made of it
let given = ""; // the answer that is on its way, in words
let news = ""; // what was saved or undone, told together with what comes next

function arrive() {
  const page = $("example");
  if (!page || page.dataset.n === undefined || !page.isConnected) return leaveStage();
  document.body.removeAttribute("data-done");
  const data = JSON.parse(page.dataset.places);
  const names = { own: page.dataset.own, donor: page.dataset.donor };
  shown = { ...data, names, n: Number(page.dataset.n), ready: false, since: performance.now() };
  for (const place of document.querySelectorAll("[data-name]")) place.textContent = names[place.dataset.name];
  box.setAttribute("aria-label", `${names.donor}’s map, laid on ${names.own}’s`);
  const before = left.get(shown.n);
  if (before) $("note").value = before.reason;
  fetchMaps(shown, before);
}

async function fetchMaps(example, before) {
  box.setAttribute("aria-busy", "true");
  try {
    const [own, donor] = await Promise.all([picture(example.own.url), picture(example.donor.url)]);
    if (example !== shown) return; // another one has come meanwhile
    const hypotheses = example.hypotheses.map((h) => ({ x: h.x_m, y: h.y_m, yaw: h.yaw_rad, scale: h.scale }));
    const scene = {
      own: { ...example.own, picture: own, name: example.names.own },
      donor: { ...example.donor, picture: donor, name: example.names.donor },
      hypotheses,
      picked: before?.picked ?? 0,
    };
    const start = before?.pose ?? hypotheses[0] ?? onTop(scene);
    example.ready = true;
    stage.show(scene, start);
    box.removeAttribute("aria-busy");
    box.dataset.shown = example.n;
    arrived(example);
  } catch (error) {
    if (example === shown) fail(`The maps of this example cannot be shown (${error.message}). Skip it, or reload the page.`);
  }
}

function arrived(example) {
  pressPicked();
  looks.tell();
  posed();
  const since = asked;
  requestAnimationFrame(() => setTimeout(() => painted(since)));
  if (asked && [document.body, null].includes(document.activeElement)) box.focus({ preventScroll: true });
  asked = 0;
  speak(`${news} ${$("question").textContent.trim().replace(/\s+/g, " ")} ${$("example").dataset.told}`.trim());
  news = "";
  setTimeout(() => whileLooking(example.next)); // what is not needed at once comes after the maps are on the screen
}

// Called when the frame with the new maps is on the screen; the browser's tools, and ours, read these times.
function painted(since) {
  if (since) performance.measure("next", { start: since, end: performance.now() });
  else if (!performance.getEntriesByName("ready").length) performance.mark("ready");
}

function whileLooking(next) {
  const base = document.body.dataset.base;
  if (judged !== null) htmx.ajax("GET", `${base}/revealed/${judged}`, { target: "#last", swap: "innerHTML" });
  judged = null;
  if (next === null) return;
  for (const whose of ["own", "donor"]) picture(`${base}/picture/${next}/${whose}.png`).catch(() => {}); // asked for again when it is shown
}

function leaveStage() {
  shown = null;
  stage.clear();
  document.body.setAttribute("data-done", "");
  if (news) speak(`${news} ${$("example")?.textContent.trim() ?? ""}`);
  news = "";
  whileLooking(null);
}

// Where the donor's map lies, in words beside the stage, and on the button that says "right".
function posed() {
  if (!shown?.ready) return;
  const first = shown.judged ? stage.scene.hypotheses[0] : null;
  const from = stage.from(first);
  const far = from !== null && (from.metres > shown.tolerance_m || from.degrees > shown.tolerance_deg);
  shown.verdict = { far, moved: first === null || from.metres > 1e-6 || from.degrees > 1e-6 };
  $("pose").textContent = poseWords(from);
  $("words").textContent = ""; // was true where the map lay
  const note = $("as-right");
  if (note) note.textContent = first === null || far ? "where it lies now" : shown.verdict.moved ? "place refined" : "";
  const reset = $("reset");
  if (reset) reset.disabled = !shown.verdict.moved && stage.scene.picked === 0;
}

function poseWords(from) {
  const { x, y, yaw } = stage.pose;
  const where = `x ${x.toFixed(2)} m, y ${y.toFixed(2)} m, ${degrees(yaw).toFixed(1)}°`;
  if (from === null) return `${where}: nothing was proposed, put it where it belongs`;
  if (!shown.verdict.moved) return `${where}: as proposed`;
  const away = `${where}: ${from.metres.toFixed(2)} m and ${from.degrees.toFixed(1)}° from the proposal`;
  return shown.verdict.far ? `${away}, which “right” calls wrong` : away;
}

// The middles of the two maps on each other: where a map lies for which no place was proposed.
function onTop({ own, donor }) {
  const [[ox, oy], [dx, dy]] = [middle(own), middle(donor)];
  return { x: ox - dx, y: oy - dy, yaw: 0, scale: 1 };
}

const step = () => shown?.step_m ?? 0.1;

function press(id) {
  const button = $(id);
  if (button && !button.disabled && !document.querySelector("#example .htmx-request")) button.click();
}

const actions = {
  right: () => press("right"),
  wrong: () => press("wrong"),
  unsure: () => press("unsure"),
  undo: () => press("undo"),
  skip: () => press("skip"),
  overlay: () => looks.look("overlay"),
  swap: () => looks.look("swap"),
  difference: () => looks.look(stage.how.mode === "difference" ? "overlay" : "difference"),
  blink: looks.blink,
  view: () => setViewMode(!viewMode),
  help: () => $("help").showModal(),
  note: () => $("note")?.focus(),
  leave: () => box.focus(),
  words() {
    if (shown?.ready) $("words").textContent = inWords(stage.scene.own, stage.scene.donor, stage.pose);
  },
  fit() {
    if (!shown?.ready) return;
    shown.all = !shown.all;
    (shown.all ? stage.lookAtAll : stage.lookAtOverlap)();
  },
  zoom: (factor) => shown?.ready && stage.zoom(factor),
  step(du, dv) {
    if (!shown?.ready) return;
    if (viewMode) return stage.pan(-du * 24, dv * 24);
    stage.setPose(moved(stage.pose, du * step(), dv * step()), { settled: false });
    tellPose();
  },
  turn(steps) {
    if (!shown?.ready) return;
    stage.setPose(turned(stage.pose, stage.pivot(), radians(TURN_DEG * steps)));
    tellPose();
  },
  pick(index) {
    if (!shown?.ready || index >= stage.scene.hypotheses.length) return;
    stage.pick(index);
    stage.lookAtOverlap();
    pressPicked();
    speak(`Place ${index + 1} of ${stage.scene.hypotheses.length}: ${$("pose").textContent}`);
  },
  reset() {
    if (!shown?.ready) return;
    if (stage.scene.hypotheses.length) stage.pick(stage.scene.picked);
    else stage.setPose(onTop(stage.scene), { settled: true });
    stage.lookAtOverlap();
    speak(`Back: ${$("pose").textContent}`);
  },
};

let telling = 0;
function tellPose() {
  clearTimeout(telling);
  telling = setTimeout(() => speak($("pose").textContent), 350); // when the keys have come to rest
}

function setViewMode(on) {
  viewMode = on;
  box.dataset.hand = on ? "view" : "map";
  $("view").setAttribute("aria-pressed", String(on));
  speak(on ? "Dragging and arrow keys pan" : "Dragging and arrow keys move the overlaid map");
}

function pressPicked() {
  for (const button of document.querySelectorAll("[data-pick]")) {
    button.setAttribute("aria-pressed", String(Number(button.dataset.pick) === stage.scene?.picked));
  }
}

function dropped(kind) {
  speak(kind === "back" ? "Snapped back onto the proposed place" : $("pose").textContent);
}

function fail(sentence) {
  $("alarm").textContent = sentence;
  $("alarm").hidden = false;
}

// What a click does that is not left to htmx.
document.addEventListener("click", (event) => {
  const button = event.target.closest?.("[data-do], [data-pick], [data-look], [data-reason]");
  if (!button || button.disabled) return;
  const { do: name, pick, look: mode, reason, value } = button.dataset;
  if (mode) actions[mode]();
  else if (pick) actions.pick(Number(pick));
  else if (reason) addReason(reason);
  else actions[name](...(value ? [Number(value)] : []));
});

function addReason(reason) {
  const note = $("note");
  if (note.value.includes(reason)) return;
  note.value = [note.value.trim(), reason].filter(Boolean).join("; ");
  speak(`Noted: ${reason}`);
}

// The answer takes along where the map lies. What is shown is what is judged: "right" far from the proposal says that
// the proposal was wrong and the place shown is right; "wrong" and "unsure" give no place.
document.addEventListener("htmx:configRequest", (event) => {
  if (event.detail.target.id === "example") asked = acted;
  if (event.detail.elt.id !== "answer") return;
  if (!shown?.ready) return event.preventDefault(); // nobody judges what cannot be seen yet
  const sent = event.detail.parameters;
  const here = sent.label === "right" && shown.verdict.moved;
  if (sent.label === "right" && shown.verdict.far) sent.label = "wrong";
  const { x, y, yaw, scale } = stage.pose;
  Object.assign(sent, { x_m: x, y_m: y, yaw_rad: yaw, scale, moved: here ? 1 : 0 });
  sent.elapsed_s = ((performance.now() - shown.since) / 1000).toFixed(3);
  left.set(shown.n, { pose: stage.pose, picked: stage.scene.picked, reason: $("note").value });
  given = `Saved: ${sent.label}${here ? ", with the place" : ""}.`;
});

for (const kind of ["keydown", "pointerup"]) document.addEventListener(kind, (event) => (acted = event.timeStamp), true);
document.addEventListener("answered", (event) => {
  $("alarm").hidden = true;
  judged = event.detail.n;
  news = given;
});
document.addEventListener("undone", () => {
  $("alarm").hidden = true;
  $("last").replaceChildren();
  news = "Undone.";
});
document.addEventListener("htmx:load", (event) => event.detail.elt.id === "example" && arrive());
document.addEventListener("htmx:sendError", () => fail("Not saved: the server does not answer. Start it again, and open the address it prints; all earlier answers are kept."));
document.addEventListener("htmx:responseError", (event) => fail(`Not done: ${event.detail.xhr.responseText || event.detail.xhr.status}`));

$("opacity").addEventListener("input", (event) => {
  stage.setHow({ opacity: event.target.value / 100 });
  event.target.setAttribute("aria-valuetext", `${event.target.value} percent`);
});
$("one-key").checked = kept("one-key") !== "off";
$("one-key").addEventListener("change", (event) => keep("one-key", event.target.checked ? "on" : "off"));
gestures(stage, box, { handle: $("handle"), viewMode: () => viewMode, cell: step, say: dropped });
listen(actions, { oneKey: () => $("one-key").checked, open: () => $("help").open });
arrive();
