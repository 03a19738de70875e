// Paints the two maps on the canvas: on each other, one alone, or what they say of each other.

import { canvas, tinted } from "./pictures.js";

const COLOURS = [
  "void", "known", "own-free", "own-wall", "donor-free", "donor-wall",
  "one-free", "one-wall", "both-free", "both-wall", "donor-hits", "own-hits",
];
let spare = canvas(1, 1);

// The colours of the style sheet, as they are now (they change with the screen's scheme).
export function palette(element) {
  const style = getComputedStyle(element);
  const read = (name) => style.getPropertyValue(name).trim();
  return { blend: read("--blend"), ...Object.fromEntries(COLOURS.map((name) => [name, read(`--map-${name}`)])) };
}

// view: { x, y, k, width, height, ratio } – the middle in metres, pixels per metre, size in CSS pixels, device pixels.
// own, donor: { picture, px_m, x_m, y_m, pose }. how: { mode: overlay | swap | difference, opacity, alone: own | donor }.
export function paint(target, view, own, donor, how, colours) {
  const [width, height] = [Math.round(view.width * view.ratio), Math.round(view.height * view.ratio)];
  for (const one of [target, spare]) {
    if (one.width !== width) one.width = width;
    if (one.height !== height) one.height = height;
  }
  const pen = target.getContext("2d");
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.globalCompositeOperation = "source-over";
  pen.globalAlpha = 1;
  pen.fillStyle = colours.void;
  pen.fillRect(0, 0, width, height);
  const layers = { own: { ...own, at: matrix(view, own) }, donor: { ...donor, at: matrix(view, donor) } };
  if (how.mode === "difference") difference(pen, layers, colours);
  else if (how.mode === "swap") one(pen, layers[how.alone], how.alone, colours);
  else overlay(pen, layers, how.opacity, colours);
}

// From pixels of a picture to pixels of the canvas, as setTransform takes it.
function matrix(view, map) {
  const { pose } = map;
  const k = view.k * view.ratio;
  const c = k * pose.scale * Math.cos(pose.yaw);
  const s = k * pose.scale * Math.sin(pose.yaw);
  const [x, y] = [map.x_m, map.y_m + map.picture.height * map.px_m]; // the upper left corner
  const left = (pose.x - view.x) * k + (view.width * view.ratio) / 2;
  const up = (view.height * view.ratio) / 2 - (pose.y - view.y) * k;
  return [c * map.px_m, -s * map.px_m, s * map.px_m, c * map.px_m, left + c * x - s * y, up - s * x - c * y];
}

function put(pen, mask, at) {
  pen.setTransform(...at);
  pen.imageSmoothingEnabled = Math.hypot(at[0], at[1]) < 1; // small: averaged; large: every cell a square
  pen.imageSmoothingQuality = "medium";
  pen.drawImage(mask, 0, 0);
  pen.setTransform(1, 0, 0, 1, 0, 0);
}

function one(pen, map, whose, colours) {
  put(pen, tinted(map.picture.known, colours.known), map.at);
  pen.globalCompositeOperation = colours.blend;
  put(pen, tinted(map.picture.free, colours[`${whose}-free`]), map.at);
  walls(pen, map, colours[`${whose}-wall`]);
  pen.globalCompositeOperation = "source-over";
}

// Free space that only one map knows in that map's tint, what both know plain; walls of both darken each other.
function overlay(pen, { own, donor }, opacity, colours) {
  put(pen, tinted(own.picture.known, colours.known), own.at);
  pen.globalAlpha = opacity;
  put(pen, tinted(donor.picture.known, colours.known), donor.at);
  pen.globalAlpha = 1;
  const mix = cleared();
  put(mix, tinted(own.picture.free, colours["own-free"]), own.at);
  mix.globalCompositeOperation = "xor";
  mix.globalAlpha = opacity;
  put(mix, tinted(donor.picture.free, colours["donor-free"]), donor.at);
  mix.globalAlpha = 1;
  pen.drawImage(spare, 0, 0);
  pen.globalCompositeOperation = colours.blend;
  walls(pen, own, colours["own-wall"]);
  pen.globalAlpha = opacity;
  walls(pen, donor, colours["donor-wall"]);
  pen.globalCompositeOperation = "source-over";
  pen.globalAlpha = 1;
}

// Walls are thin: where several cells share a pixel they are drawn a cell wider, so that none gets lost, and where a
// cell has hardly more than a pixel they are drawn a pixel wider, so that lines are seen from afar.
function walls(pen, map, colour) {
  const scale = Math.hypot(map.at[0], map.at[1]);
  if (scale < 0.8 || scale > 2.5) return put(pen, tinted(scale < 0.8 ? map.picture.nearWalls : map.picture.walls, colour), map.at);
  const mix = cleared(); // drawn once, however often its parts lie on each other
  for (const [x, y] of [[0, 0], [1, 0], [0, 1]]) put(mix, tinted(map.picture.walls, colour), shifted(map.at, x, y));
  pen.drawImage(spare, 0, 0);
}

const shifted = ([a, b, c, d, e, f], x, y) => [a, b, c, d, e + x, f + y];

function difference(pen, { own, donor }, colours) {
  for (const map of [own, donor]) {
    put(pen, tinted(map.picture.known, colours.known), map.at);
    put(pen, tinted(map.picture.free, colours["one-free"]), map.at);
  }
  for (const map of [own, donor]) walls(pen, map, colours["one-wall"]);
  both(pen, own, "free", donor, "free", colours["both-free"]);
  both(pen, own, "walls", donor, "nearWalls", colours["both-wall"], true);
  both(pen, donor, "walls", own, "nearWalls", colours["both-wall"], true);
  both(pen, own, "walls", donor, "clear", colours["own-hits"], true);
  both(pen, donor, "walls", own, "clear", colours["donor-hits"], true);
}

function cleared() {
  const mix = spare.getContext("2d");
  mix.globalCompositeOperation = "copy";
  mix.fillStyle = "#0000";
  mix.fillRect(0, 0, spare.width, spare.height);
  mix.globalCompositeOperation = "source-over";
  return mix;
}

// What two masks have in common, in one colour; “wide” as walls are, a pixel to all sides where they are thin.
function both(pen, a, nameA, b, nameB, colour, wide = false) {
  const mix = cleared();
  put(mix, tinted(a.picture[nameA], colour), a.at);
  mix.globalCompositeOperation = "destination-in";
  put(mix, b.picture[nameB], b.at);
  pen.drawImage(spare, 0, 0);
  if (!wide || Math.hypot(a.at[0], a.at[1]) > 1.5) return;
  for (const [x, y] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) pen.drawImage(spare, x, y);
}
