// What two maps placed on each other have in common: where to look, what to turn about, and the same in words.

import { UNKNOWN, WALL } from "./pictures.js";
import { applied } from "./pose.js";

const LOOKED_AT = 120_000; // pixels of the donor's map, at most, when only the place is wanted

// Corners of a picture in its map's frame, counter-clockwise.
export function corners(map) {
  const [right, top] = [map.x_m + map.picture.width * map.px_m, map.y_m + map.picture.height * map.px_m];
  return [[map.x_m, map.y_m], [right, map.y_m], [right, top], [map.x_m, top]];
}

export function bounds(points) {
  const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
  return { x0: Math.min(...xs), y0: Math.min(...ys), x1: Math.max(...xs), y1: Math.max(...ys) };
}

// The part of the receiver's frame that both maps know: { count, bounds, middle }, the latter null where there is none.
export function overlap(own, donor, pose) {
  const step = Math.max(1, Math.ceil(Math.sqrt(donor.picture.classes.length / LOOKED_AT)));
  let [count, sumX, sumY] = [0, 0, 0];
  const box = { x0: Infinity, y0: Infinity, x1: -Infinity, y1: -Infinity };
  each(own, donor, pose, step, (ofOwn, _near, _ofDonor, _nearDonor, x, y) => {
    if (ofOwn === UNKNOWN) return;
    count += 1;
    sumX += x;
    sumY += y;
    box.x0 = Math.min(box.x0, x);
    box.x1 = Math.max(box.x1, x);
    box.y0 = Math.min(box.y0, y);
    box.y1 = Math.max(box.y1, y);
  });
  if (count < 20) return { count, bounds: null, middle: null };
  return { count, bounds: box, middle: [sumX / count, sumY / count] };
}

// What the difference view shows, counted: square metres known to both, and shares of it.
export function compared(own, donor, pose) {
  const told = { both: 0, agree: 0, walls: 0, ownHits: 0, donorHits: 0, side: [0, 0] };
  each(own, donor, pose, 1, (ofOwn, nearOwn, ofDonor, nearDonor, x, y) => {
    if (ofOwn === UNKNOWN) return;
    told.both += 1;
    if (ofOwn === ofDonor) told.agree += 1;
    if ((ofOwn === WALL && nearDonor) || (ofDonor === WALL && nearOwn)) told.walls += 1;
    else if (ofDonor === WALL || ofOwn === WALL) {
      told[ofDonor === WALL ? "donorHits" : "ownHits"] += 1;
      told.side[0] += x;
      told.side[1] += y;
    }
  });
  const hits = told.ownHits + told.donorHits;
  const pixel = (donor.px_m * pose.scale) ** 2;
  return { ...told, area: told.both * pixel, side: hits ? [told.side[0] / hits, told.side[1] / hits] : null };
}

// Calls seen(class of own, whether own has a wall near, the same of the donor, x, y) for known pixels of the donor's map.
function each(own, donor, pose, step, seen) {
  const { width, height, classes, near } = donor.picture;
  const ours = own.picture;
  for (let v = 0; v < height; v += step) {
    for (let u = 0; u < width; u += step) {
      const i = v * width + u;
      if (classes[i] === UNKNOWN) continue;
      const there = [donor.x_m + (u + 0.5) * donor.px_m, donor.y_m + (height - v - 0.5) * donor.px_m];
      const [x, y] = applied(pose, there);
      const column = Math.floor((x - own.x_m) / own.px_m);
      const row = ours.height - 1 - Math.floor((y - own.y_m) / own.px_m);
      const inside = column >= 0 && row >= 0 && column < ours.width && row < ours.height;
      const j = row * ours.width + column;
      seen(inside ? ours.classes[j] : UNKNOWN, inside && ours.near[j], classes[i], near[i], x, y);
    }
  }
}

// The middle of what a map knows, in its own frame.
export function middle(map) {
  const { width, height, classes } = map.picture;
  let [count, sumU, sumV] = [0, 0, 0];
  for (let i = 0; i < classes.length; i++) {
    if (classes[i] === UNKNOWN) continue;
    count += 1;
    sumU += i % width;
    sumV += Math.floor(i / width);
  }
  const [u, v] = count ? [sumU / count + 0.5, sumV / count + 0.5] : [width / 2, height / 2];
  return [map.x_m + u * map.px_m, map.y_m + (height - v) * map.px_m];
}

const SIDES = ["east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east"];

// The two maps in words, for those who do not see them: nothing that the robot judged is in it.
export function inWords(own, donor, pose) {
  const seen = compared(own, donor, pose);
  if (seen.both < 20) return `As it lies, ${donor.name}'s map has nothing in common with ${own.name}'s.`;
  const percent = (n) => `${((100 * n) / seen.both).toFixed(1)} %`;
  const sentences = [
    `Both know ${seen.area.toFixed(1)} m²; ${percent(seen.agree)} of it is called the same.`,
    `Walls in both: ${percent(seen.walls)}.`,
    `${donor.name} has walls where ${own.name} sees free space: ${percent(seen.donorHits)};`,
    `the other way round: ${percent(seen.ownHits)}.`,
  ];
  if (seen.side) {
    const [mx, my] = overlap(own, donor, pose).middle ?? seen.side;
    const [dx, dy] = [seen.side[0] - mx, seen.side[1] - my];
    const where = Math.hypot(dx, dy) < 0.5 ? "all over" : `most of it to the ${SIDES[Math.round((Math.atan2(dy, dx) / Math.PI) * 4 + 8) % 8]}`;
    sentences.push(`What contradicts lies ${where}.`);
  }
  return sentences.join(" ");
}
