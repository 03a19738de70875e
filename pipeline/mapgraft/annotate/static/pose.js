// Where the donor's map lies in the receiver's: { x, y, yaw, scale }, metres and radians, p_receiver = T · p_donor.

export const degrees = (rad) => (rad * 180) / Math.PI;
export const radians = (deg) => (deg * Math.PI) / 180;

// The same angle in (−π, π].
export function wrapped(angle) {
  const turn = 2 * Math.PI;
  const rest = ((angle % turn) + turn) % turn;
  return rest > Math.PI ? rest - turn : rest;
}

export function applied(pose, [x, y]) {
  const c = pose.scale * Math.cos(pose.yaw);
  const s = pose.scale * Math.sin(pose.yaw);
  return [c * x - s * y + pose.x, s * x + c * y + pose.y];
}

export function appliedBack(pose, [x, y]) {
  const c = Math.cos(pose.yaw) / pose.scale;
  const s = Math.sin(pose.yaw) / pose.scale;
  const [dx, dy] = [x - pose.x, y - pose.y];
  return [c * dx + s * dy, c * dy - s * dx];
}

export const moved = (pose, dx, dy) => ({ ...pose, x: pose.x + dx, y: pose.y + dy });

// Turned by an angle about a point of the receiver's frame, which stays where it is.
export function turned(pose, [px, py], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const [dx, dy] = [pose.x - px, pose.y - py];
  return { ...pose, x: px + c * dx - s * dy, y: py + s * dx + c * dy, yaw: wrapped(pose.yaw + angle) };
}

// How far a point of the donor's map lies from where another pose puts it, and by what angle the poses differ.
export function apart(a, b, point) {
  const [ax, ay] = applied(a, point);
  const [bx, by] = applied(b, point);
  return { metres: Math.hypot(ax - bx, ay - by), degrees: Math.abs(degrees(wrapped(a.yaw - b.yaw))) };
}
