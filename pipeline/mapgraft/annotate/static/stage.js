// The stage: two maps to scale, the view onto them, and where the donor's map lies. Everything in metres of the
// receiver's frame, y up; the screen in CSS pixels from the upper left corner.

import { bounds, corners, middle, overlap } from "./facts.js";
import { mark } from "./marks.js";
import { paint, palette } from "./painting.js";
import { apart, applied, appliedBack } from "./pose.js";

const CLOSEST = 800; // pixels per metre
const FARTHEST = 0.5;

export function createStage(box, canvas, svg, changed) {
  const how = { mode: "overlay", opacity: 1, alone: "own" };
  const view = { x: 0, y: 0, k: 20, width: 1, height: 1, ratio: 1 };
  let scene = null; // { own, donor, hypotheses, picked }
  let pose = null;
  let pivot = [0, 0]; // in the donor's frame
  let [turning, waiting, colours] = [false, false, palette(box)];

  const hypothesis = () => scene.hypotheses[scene.picked] ?? null;
  const toScreen = ([x, y]) => [(x - view.x) * view.k + view.width / 2, view.height / 2 - (y - view.y) * view.k];
  const toMap = ([u, v]) => [(u - view.width / 2) / view.k + view.x, (view.height / 2 - v) / view.k + view.y];

  function draw() {
    waiting = false;
    if (!scene || view.width < 1 || view.height < 1) return; // nothing to show, or nowhere
    const own = { ...scene.own, pose: { x: 0, y: 0, yaw: 0, scale: 1 } };
    paint(canvas, view, own, { ...scene.donor, pose }, how, colours);
    const shown = { toScreen, donor: scene.donor, pose, hypothesis: hypothesis(), turning, k: view.k, height: view.height };
    mark(svg, { ...shown, pivot: applied(pose, pivot) });
  }

  function redraw() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }

  function measure() {
    const { width, height } = box.getBoundingClientRect();
    Object.assign(view, { width, height, ratio: Math.min(3, window.devicePixelRatio || 1) });
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  }

  function look({ x0, y0, x1, y1 }, room) {
    measure();
    const k = Math.min(view.width / (x1 - x0 || 1), view.height / (y1 - y0 || 1)) / room;
    Object.assign(view, { x: (x0 + x1) / 2, y: (y0 + y1) / 2, k: Math.min(CLOSEST, Math.max(FARTHEST, k)) });
    redraw();
  }

  const everything = () => bounds([...corners(scene.own), ...corners(scene.donor).map((c) => applied(pose, c))]);

  // What both know, with some of what lies around it; everything where they have little in common.
  function lookAtOverlap() {
    const common = overlap(scene.own, scene.donor, pose).bounds;
    look(common ?? everything(), common ? 1.2 : 1.06);
  }

  function setPose(next, { settled = false } = {}) {
    pose = next;
    if (settled) {
      const common = overlap(scene.own, scene.donor, pose).middle;
      pivot = common ? appliedBack(pose, common) : middle(scene.donor);
    }
    redraw();
    changed();
  }

  function show(next, start) {
    scene = next;
    setPose(start, { settled: true });
    lookAtOverlap();
    draw();
  }

  function zoom(factor, [u, v] = [view.width / 2, view.height / 2]) {
    const before = toMap([u, v]);
    view.k = Math.min(CLOSEST, Math.max(FARTHEST, view.k * factor));
    const after = toMap([u, v]);
    view.x += before[0] - after[0];
    view.y += before[1] - after[1];
    redraw();
  }

  function pan(du, dv) {
    view.x -= du / view.k;
    view.y += dv / view.k;
    redraw();
  }

  new ResizeObserver(() => {
    measure();
    redraw();
  }).observe(box);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    colours = palette(box);
    redraw();
  });

  return {
    show, setPose, zoom, pan, toMap, toScreen, lookAtOverlap, hypothesis,
    clear: () => (scene = null),
    get scene() { return scene; },
    get pose() { return pose; },
    get view() { return { ...view }; },
    get how() { return { ...how }; },
    pivot: () => applied(pose, pivot),
    lookAtAll: () => look(everything(), 1.06),
    pick(index) {
      scene.picked = index;
      setPose(scene.hypotheses[index], { settled: true });
    },
    setHow(next) {
      Object.assign(how, next);
      redraw();
    },
    setTurning(now) {
      turning = now;
      redraw();
    },
    // How far the donor's map lies from a hypothesis: { metres, degrees }, null where there is none.
    from: (other) => (other ? apart(pose, other, pivot) : null),
  };
}
