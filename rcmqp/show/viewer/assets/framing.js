// Where the outside cameras stand.

import { addScaled, cross, dot, subtract, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vector} Vector */

const UP = [0, 0, 1];

/**
 * The direction (3,), of length 1, in which the outside camera stands: somewhat above, from where
 * base and trocar lie well apart, the base to the left if it can be, and the wall is seen from its
 * edge, so that it does not hide the trail.
 *
 * @param {Vector} base of the arm [m]
 * @param {Vector} trocar [m]
 * @param {Vector} axis of the trocar, of length 1
 */
export function outside(base, trocar, axis) {
  const level = subtract(trocar, base);
  level[2] = 0;
  const ahead = Math.hypot(...level) < 1e-3 ? [1, 0, 0] : unit(level);
  let best = { score: -Infinity, towards: UP };
  for (let degrees = 0; degrees < 360; degrees += 5) {
    const turn = (degrees * Math.PI) / 180;
    const towards = unit([Math.cos(turn), Math.sin(turn), 0.33]);
    const right = unit(cross(UP, towards));
    const inFront = 0.3 * dot(towards, ahead);
    const score = dot(right, ahead) + inFront - 3 * Math.max(0, Math.abs(dot(towards, axis)) - 0.25);
    if (score > best.score) best = { score, towards };
  }
  return best.towards;
}

/**
 * Where a camera just sees all points in a share of its image, and what it looks at.
 *
 * @param {Vector[]} points [m]
 * @param {Vector} direction of length 1 from what it looks at to the camera; not straight up or down
 * @param {{fov: number, aspect: number}} lens angle of view from top to bottom [deg], width over height
 * @param {number} margin 1 leaves none
 * @param {[number, number]} share of the image's width and height, about its middle
 * @returns {{position: Vector, target: Vector}} in the world [m]
 */
export function aim(points, direction, lens, margin, share = [1, 1]) {
  const x = unit(cross(UP, direction));
  const y = cross(direction, x);
  let target = [0, 0, 0];
  for (const axis of [x, y, direction]) {
    const along = points.map((p) => dot(p, axis));
    target = addScaled(target, (Math.min(...along) + Math.max(...along)) / 2, axis);
  }
  const half = Math.tan((lens.fov * Math.PI) / 360);
  const [wide, tall] = [half * lens.aspect * share[0], half * share[1]];
  let distance = 0.05;
  for (const p of points) {
    const seen = subtract(p, target);
    const reach = Math.max(Math.abs(dot(seen, x)) / wide, Math.abs(dot(seen, y)) / tall);
    distance = Math.max(distance, margin * reach + dot(seen, direction));
  }
  return { position: addScaled(target, distance, direction), target };
}
