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

/** The vector of length 1 in a's direction. @param {Vector} a */
export const unit = (a) => a.map((x) => x / Math.hypot(...a));
