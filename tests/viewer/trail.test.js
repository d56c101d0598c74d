import assert from "node:assert/strict";
import { test } from "node:test";

import { Trail } from "../../rcmqp/show/viewer/assets/trail.js";

/** A trail along x. @param {number[]} xs at 0, 1, 2, ... s */
function along(xs, rows = 100) {
  const trail = new Trail(rows, 0.1);
  xs.forEach((x, t) => trail.push(t, [x, 0, 0]));
  return trail;
}

/** @param {Trail} trail */
const xs = (trail) => [...trail.points].filter((_, i) => i % 3 === 0);

test("a point that stands still adds nothing until it has moved far enough", () => {
  assert.deepEqual(xs(along([0, 0, 0.06, 0.09, 0.12, 0.15, 0.5])), [0, 0.12, 0.5]);
});

test("missing points are left out, the first one too", () => {
  assert.deepEqual(xs(along([NaN, 1, NaN, 2, NaN])), [1, 2]);
  const trail = new Trail(9, 0.1);
  trail.push(0, [0, 0, 0]);
  trail.push(1, [5, NaN, 0]);
  assert.equal(trail.count, 1);
});

test("it is drawn to the point that is gone to", () => {
  const trail = along([0, 1, 1, 1, 2]); // points at 0, 1 and 4 s
  for (const [t, stretches] of [[-1, 0], [0, 0], [0.5, 1], [1, 1], [1.1, 2], [3.9, 2], [4, 2], [9, 2]])
    assert.equal(trail.stretches(t), stretches, `at ${t} s`);
  assert.equal(along([]).stretches(1), 0);
});

test("it grows without end in a fixed memory, and keeps the newest points", () => {
  const trail = along(Array.from({ length: 1000 }, (_, i) => i), 10);
  assert.equal(trail.count + trail.dropped, 1000);
  assert.ok(trail.count >= 5 && trail.count <= 10);
  assert.equal(xs(trail).at(-1), 999);
  assert.equal(trail.stretches(999), trail.count - 1);
  assert.equal(trail.stretches(0), 0);
});

test("after clear() it begins again, wherever that is", () => {
  const trail = along([0, 1, 2]);
  trail.clear();
  assert.equal(trail.count, 0);
  trail.push(0, [2, 0, 0]);
  assert.deepEqual(xs(trail), [2]);
});
