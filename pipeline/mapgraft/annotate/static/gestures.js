// Mouse, pen and touch on the stage: one pointer moves or turns the donor's map (or the view), two turn, zoom and pan.

import { moved, radians, turned, wrapped } from "./pose.js";

const TWIST = radians(5); // so far two fingers must turn before the map does
const SPREAD = 1.12; // so much they must spread before the view zooms
const SNAP_PX = 7; // and within a cell: dropped so near a hypothesis it lies on it
const SNAP_DEG = 0.4;

export function gestures(stage, box, { handle, viewMode, cell, say }) {
  const down = new Map(); // pointer → [u, v]
  let act = null; // { kind: move | turn | view | pair, scene, … }

  const place = (event) => {
    const edge = box.getBoundingClientRect();
    return [event.clientX - edge.left, event.clientY - edge.top];
  };

  box.addEventListener("pointerdown", (event) => {
    if (!stage.scene || down.size === 2) return;
    down.set(event.pointerId, place(event));
    box.setPointerCapture(event.pointerId);
    if (event.pointerType === "mouse") event.preventDefault(); // no picture is dragged, no text selected
    box.focus({ preventScroll: true });
    act = { ...(down.size === 2 ? pair([...down.values()]) : single(event)), scene: stage.scene };
    box.dataset.act = act.kind;
    stage.setTurning(act.kind === "turn");
  });

  function single(event) {
    const at = place(event);
    const start = { at, pose: stage.pose, changed: false };
    if (handle.contains(event.target) || event.shiftKey) return { ...start, kind: "turn", last: angle(at), total: 0 };
    const looks = event.button === 1 || event.button === 2 || viewMode();
    return { ...start, kind: looks ? "view" : "move", last: at };
  }

  const angle = ([u, v]) => {
    const [x, y] = stage.toScreen(stage.pivot());
    return Math.atan2(y - v, u - x);
  };

  function pair([a, b]) {
    return { kind: "pair", ...span(a, b), twist: 0, spread: 1, twisting: false, spreading: false, changed: false };
  }

  const span = ([au, av], [bu, bv]) => ({
    angle: Math.atan2(av - bv, bu - au),
    length: Math.max(1, Math.hypot(bu - au, bv - av)),
    centre: [(au + bu) / 2, (av + bv) / 2],
  });

  box.addEventListener("pointermove", (event) => {
    if (!down.has(event.pointerId) || act === null) return;
    down.set(event.pointerId, place(event));
    if (act.scene !== stage.scene) return end(); // it was meant for the maps that were there before
    if (act.kind === "pair") both([...down.values()]);
    else ({ move: drag, turn, view: lookAround })[act.kind](place(event));
  });

  function drag([u, v]) {
    const k = stage.view.k;
    const [du, dv] = [u - act.at[0], v - act.at[1]];
    act.changed ||= Math.hypot(du, dv) > 2;
    if (act.changed) stage.setPose(moved(act.pose, du / k, -dv / k));
  }

  function turn(at) {
    const now = angle(at);
    act.total += wrapped(now - act.last);
    act.last = now;
    act.changed ||= Math.abs(act.total) > 1e-4;
    stage.setPose(turned(act.pose, stage.pivot(), act.total));
  }

  function lookAround([u, v]) {
    stage.pan(u - act.last[0], v - act.last[1]);
    act.last = [u, v];
  }

  function both([a, b]) {
    const now = span(a, b);
    const [twist, spread] = [wrapped(now.angle - act.angle), now.length / act.length];
    act.twist += twist;
    act.spread *= spread;
    stage.pan(now.centre[0] - act.centre[0], now.centre[1] - act.centre[1]);
    if (act.spreading) stage.zoom(spread, now.centre);
    if (act.twisting) stage.setPose(turned(stage.pose, stage.toMap(now.centre), twist));
    act.changed ||= act.twisting;
    act.spreading ||= Math.abs(Math.log(act.spread)) > Math.log(SPREAD);
    act.twisting ||= Math.abs(act.twist) > TWIST;
    Object.assign(act, now);
  }

  function up(event) {
    if (!down.delete(event.pointerId) || act === null) return;
    const done = act;
    end();
    if (done.changed && done.scene === stage.scene) dropped(done.kind);
  }

  function end() {
    act = null;
    delete box.dataset.act;
    stage.setTurning(false);
  }
  box.addEventListener("pointerup", up);
  box.addEventListener("pointercancel", up);
  box.addEventListener("contextmenu", (event) => event.preventDefault());
  box.addEventListener("wheel", (event) => {
    event.preventDefault();
    stage.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), place(event));
  }, { passive: false });

  function dropped(kind) {
    const from = stage.from(stage.hypothesis());
    const near = Math.min(cell(), SNAP_PX / stage.view.k);
    const snaps = from !== null && from.metres <= near && from.degrees <= SNAP_DEG;
    stage.setPose(snaps ? stage.hypothesis() : stage.pose, { settled: snaps || kind === "move" });
    say(snaps ? "back" : kind);
  }
}
