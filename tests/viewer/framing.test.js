import assert from "node:assert/strict";
import { test } from "node:test";

import { aim, outside } from "../../rcmqp/show/viewer/assets/framing.js";
import { addScaled, cross, dot, subtract, unit } from "../../rcmqp/show/viewer/assets/vectors.js";

const POINTS = [[0, 0, 0], [0.3, 0.1, 0.8], [-0.2, 0.5, 0.4], [0.6, -0.4, 0.2], [0.1, 0.1, 1.1]];

/**
 * Where a pinhole camera shows a point: -1 to 1 from left to right and from bottom to top.
 *
 * @param {number[]} point
 * @param {{position: number[], target: number[]}} camera
 * @param {{fov: number, aspect: number}} lens
 */
function project(point, { position, target }, { fov, aspect }) {
  const forward = unit(subtract(target, position));
  const right = unit(cross(forward, [0, 0, 1]));
  const up = cross(right, forward);
  const seen = subtract(point, position);
  const depth = dot(seen, forward) * Math.tan((fov * Math.PI) / 360);
  return [dot(seen, right) / (depth * aspect), dot(seen, up) / depth];
}

for (const aspect of [0.4, 1, 2.5])
  for (const direction of [[1, 0, 0.33], [-0.4, 0.9, 0.33], [0, -1, 2]])
    test(`all points are just inside the image, aspect ${aspect}, from ${direction}`, () => {
      const lens = { fov: 26, aspect };
      const camera = aim(POINTS, unit(direction), lens, 1);
      const reach = POINTS.map((p) => Math.max(...project(p, camera, lens).map(Math.abs)));
      assert.ok(Math.max(...reach) <= 1 + 1e-9);
      assert.ok(Math.max(...reach) > 1 - 1e-9);
    });

test("a share of the image is left free, and a margin", () => {
  const lens = { fov: 26, aspect: 1.6 };
  const camera = aim(POINTS, unit([1, 0.2, 0.33]), lens, 1, [0.5, 0.7]);
  const places = POINTS.map((p) => project(p, camera, lens).map(Math.abs));
  assert.ok(places.every(([x, y]) => x <= 0.5 + 1e-9 && y <= 0.7 + 1e-9));
  const further = aim(POINTS, unit([1, 0.2, 0.33]), lens, 1.3, [0.5, 0.7]);
  assert.ok(Math.hypot(...subtract(further.position, further.target)) > Math.hypot(...subtract(camera.position, camera.target)));
});

test("the camera looks along the direction, from no nearer than 5 cm", () => {
  const direction = unit([0.3, -0.8, 0.4]);
  const { position, target } = aim([[1, 2, 3]], direction, { fov: 40, aspect: 1 }, 1);
  assert.ok(Math.hypot(...subtract(target, [1, 2, 3])) < 1e-12);
  assert.ok(Math.hypot(...subtract(position, addScaled(target, 0.05, direction))) < 1e-12);
});

test("the camera stands where the base is to the left of the trocar", () => {
  for (const [base, trocar] of [[[0, 0, 0], [0.5, 0, 0.2]], [[1, 1, 0], [0.7, 1.4, 0.1]]]) {
    const direction = outside(base, trocar, [0, 0, -1]);
    assert.ok(Math.abs(Math.hypot(...direction) - 1) < 1e-12);
    assert.ok(direction[2] > 0.2 && direction[2] < 0.5);
    const right = cross([0, 0, 1], direction);
    assert.ok(dot(subtract(trocar, base), right) > 0.8 * Math.hypot(trocar[0] - base[0], trocar[1] - base[1]));
  }
});

test("the camera sees the wall from its edge", () => {
  const axis = unit([0, 1, 0]); // the camera would stand at y < 0
  const straight = outside([0, 0, 0], [0.5, 0, 0.2], [0, 0, -1]);
  const aside = outside([0, 0, 0], [0.5, 0, 0.2], axis);
  assert.ok(Math.abs(dot(straight, axis)) > 0.8);
  assert.ok(Math.abs(dot(aside, axis)) < 0.4);
});

test("a trocar straight above the base has a view too", () => {
  const direction = outside([0.1, 0.2, 0], [0.1, 0.2, 0.5], [0, 0, -1]);
  assert.ok(direction.every(Number.isFinite));
});
