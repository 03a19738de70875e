// What is drawn over the maps in SVG: the outline of the donor's map, where it came from, the handle, the scale bar.

import { applied, degrees, wrapped } from "./pose.js";
import { corners } from "./facts.js";

const ARM = 92; // CSS pixels from the point that is turned about to the knob
const BAR = [70, 170]; // CSS pixels: how long the scale bar may be

// shown: { toScreen, donor, pose, hypothesis (null where there is none), pivot (receiver's frame), turning, k, height }
export function mark(svg, shown) {
  const at = (name) => svg.querySelector(`[data-mark="${name}"]`);
  const outline = (pose) => corners(shown.donor).map((c) => shown.toScreen(applied(pose, c)).join(",")).join(" ");
  at("outline").setAttribute("points", outline(shown.pose));
  at("ghost").setAttribute("points", shown.hypothesis ? outline(shown.hypothesis) : "");
  handle(at, shown);
  bar(at, shown);
}

export function armAngle(pose, hypothesis) {
  return wrapped(pose.yaw - (hypothesis ? hypothesis.yaw : 0)) + Math.PI / 2; // upright where nothing was turned
}

function handle(at, shown) {
  const [x, y] = shown.toScreen(shown.pivot);
  const angle = armAngle(shown.pose, shown.hypothesis);
  const [kx, ky] = [x + ARM * Math.cos(angle), y - ARM * Math.sin(angle)];
  for (const name of ["pivot", "ring"]) place(at(name), { cx: x, cy: y });
  for (const name of ["knob", "grip"]) place(at(name), { cx: kx, cy: ky });
  place(at("arm"), { x1: x, y1: y, x2: kx, y2: ky });
  place(at("arrows"), { transform: `translate(${kx} ${ky}) rotate(${90 - degrees(angle)})` });
  at("ring").toggleAttribute("hidden", !shown.turning);
}

function bar(at, shown) {
  const metres = roundLength(BAR[1] / shown.k);
  const [left, y, length] = [14, shown.height - 14, metres * shown.k];
  at("bar").setAttribute("d", `M${left} ${y - 6}V${y}H${left + length}V${y - 6}`);
  place(at("length"), { x: left + 5, y: y - 5 });
  at("length").textContent = metres >= 1 ? `${metres} m` : `${Math.round(metres * 100)} cm`;
}

// The longest of 1, 2, 5 times a power of ten that is no longer.
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return power * [5, 2, 1].find((digit) => digit * power <= most);
}

function place(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}
