import assert from "node:assert/strict";
import { test } from "node:test";

import { fitting, hundredth, largest, logarithmic, step } from "../../rcmqp/show/viewer/assets/scales.js";

/** @param {number[]} values */
const curve = (...values) => new Float32Array(values);

test("missing numbers are neither the largest nor among the lowest", () => {
  assert.equal(largest(curve(1, NaN, 3, 2)), 3);
  assert.equal(largest(curve(NaN)), 0);
  assert.equal(hundredth(curve(NaN, 3, 2, NaN)), 2);
  const hundred = Float32Array.from({ length: 200 }, (_, i) => 200 - i);
  assert.equal(hundredth(hundred), 3);
});

test("the lowest hundredth is found by value, not by how numbers are spelt", () => {
  assert.equal(hundredth(curve(10, 9, 100)), 9);
});

test("an axis is logarithmic only where the curves' maxima are far apart", () => {
  assert.equal(logarithmic([curve(1, 2), curve(50)]), null); // 25 times
  assert.equal(logarithmic([curve(1, 2)]), null);
  assert.equal(logarithmic([curve(0), curve(5)]), null); // nothing to draw at zero
  const range = logarithmic([curve(1, 2), curve(70, 80)]);
  assert.ok(range);
  assert.ok(Math.abs(range[0] - Math.log10(0.5)) < 1e-6);
  assert.ok(Math.abs(range[1] - Math.log10(80) - 0.3) < 1e-6);
});

test("a logarithmic axis goes no more than three decades below the least maximum", () => {
  const range = logarithmic([curve(1e-12, 1e-12, 2), curve(1e-12, 200)]);
  assert.ok(range);
  assert.ok(Math.abs(range[0] - Math.log10(2e-3)) < 1e-6);
});

test("the RCM error is magnified as much as fits into 3 cm", () => {
  for (const [most, factor] of [[1e-4, 10000], [2.9e-3, 10000], [0.004, 1000], [2, 10], [4, 1], [1000, 1]])
    assert.equal(fitting([curve(most, NaN), curve(0.5 * most)]), factor, `${most} mm`);
});

test("steps along a list end at its ends", () => {
  const list = [1, 2, 4];
  assert.deepEqual([step(list, 2, 1), step(list, 4, 1), step(list, 2, -1), step(list, 1, -1)], [4, 4, 1, 1]);
});
