// Maps as the server's PNGs hold them (the first row is north; walls dark or coloured, free space light, unknown
// transparent or grey), as masks to draw with.

export const UNKNOWN = 0;
export const FREE = 1;
export const WALL = 2;

const KEPT = 12; // pictures; an example has two
const loaded = new Map(); // url → promise of a picture, oldest first

// A picture, from memory when it was asked for before; rejects when the server does not give it.
export function picture(url) {
  let promise = loaded.get(url);
  if (promise === undefined) {
    promise = read(url);
    promise.catch(() => loaded.delete(url)); // asked for again the next time
  }
  loaded.delete(url);
  loaded.set(url, promise);
  while (loaded.size > KEPT) loaded.delete(loaded.keys().next().value);
  return promise;
}

async function read(url) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${answer.status} instead of a picture`);
  const bitmap = await createImageBitmap(await answer.blob());
  const { width, height } = bitmap;
  const pen = canvas(width, height).getContext("2d", { willReadFrequently: true });
  pen.drawImage(bitmap, 0, 0);
  bitmap.close();
  return made(classified(pen.getImageData(0, 0, width, height).data), width, height);
}

function classified(rgba) {
  const classes = new Uint8Array(rgba.length / 4);
  for (let i = 0, p = 0; i < classes.length; i++, p += 4) {
    if (rgba[p + 3] < 128) continue;
    const [red, green, blue] = [rgba[p], rgba[p + 1], rgba[p + 2]];
    const light = 0.3 * red + 0.6 * green + 0.1 * blue;
    if (light > 230) classes[i] = FREE;
    else if (light < 110 || Math.max(red, green, blue) - Math.min(red, green, blue) > 60) classes[i] = WALL;
  }
  return classes;
}

function made(classes, width, height) {
  const near = beside(classes, width, height);
  const mask = (holds) => masked(classes.length, width, height, holds);
  return {
    width,
    height,
    classes,
    near,
    known: mask((i) => classes[i] !== UNKNOWN),
    free: mask((i) => classes[i] === FREE),
    walls: mask((i) => classes[i] === WALL),
    nearWalls: mask((i) => near[i]), // a wall, or within a pixel of one
    clear: mask((i) => classes[i] === FREE && !near[i]), // free, and no wall within a pixel
  };
}

function beside(classes, width, height) {
  const near = new Uint8Array(classes.length);
  for (let v = 0, i = 0; v < height; v++) {
    for (let u = 0; u < width; u++, i++) {
      if (classes[i] !== WALL) continue;
      for (let y = Math.max(0, v - 1); y <= Math.min(height - 1, v + 1); y++) {
        near.fill(1, y * width + Math.max(0, u - 1), y * width + Math.min(width - 1, u + 1) + 1);
      }
    }
  }
  return near;
}

function masked(length, width, height, holds) {
  const image = new ImageData(width, height);
  for (let i = 0; i < length; i++) if (holds(i)) image.data[4 * i + 3] = 255;
  const drawn = canvas(width, height);
  drawn.getContext("2d").putImageData(image, 0, 0);
  return drawn;
}

const tints = new WeakMap(); // mask → colour → the mask in that colour

export function tinted(mask, colour) {
  if (!tints.has(mask)) tints.set(mask, new Map());
  const known = tints.get(mask);
  if (!known.has(colour)) {
    const drawn = canvas(mask.width, mask.height);
    const pen = drawn.getContext("2d");
    pen.drawImage(mask, 0, 0);
    pen.globalCompositeOperation = "source-in";
    pen.fillStyle = colour;
    pen.fillRect(0, 0, drawn.width, drawn.height);
    known.set(colour, drawn);
  }
  return known.get(colour);
}

export function canvas(width, height) {
  const made = document.createElement("canvas");
  made.width = width;
  made.height = height;
  return made;
}
