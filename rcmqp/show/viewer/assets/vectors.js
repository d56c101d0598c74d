// Vectors in space as plain arrays (3,).

/** @typedef {number[]} Vector */

/** @param {Vector} a @param {Vector} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @param {Vector} a @param {Vector} b */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** @param {Vector} a @param {Vector} b */
export const subtract = (a, b) => a.map((x, i) => x - b[i]);

/** a + s b. @param {Vector} a @param {number} s @param {Vector} b */
export const addScaled = (a, s, b) => a.map((x, i) => x + s * b[i]);

/**
 * The part about an axis of the turn from one attitude to another [rad].
 *
 * @param {Vector} axis of length 1
 * @param {number[]} from quaternion (4,), x, y, z, w
 * @param {number[]} to likewise
 */
export function turnAbout(axis, from, to) {
  const [a, b] = [from.slice(0, 3), to.slice(0, 3)];
  const crossed = cross(b, a);
  const along = dot(axis, b.map((x, i) => x * from[3] - a[i] * to[3] - crossed[i]));
  const turn = 2 * Math.atan2(along, to[3] * from[3] + dot(a, b));
  return Math.atan2(Math.sin(turn), Math.cos(turn));
}

/** The vector of length 1 in a's direction. @param {Vector} a */
export const unit = (a) => a.map((x) => x / Math.hypot(...a));
