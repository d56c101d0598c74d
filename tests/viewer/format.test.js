import assert from "node:assert/strict";
import { test } from "node:test";

import { clockText, decimals, depth, millimetres } from "../../rcmqp/show/viewer/assets/format.js";

test("lengths are in millimetres with three significant digits", () => {
  /** @type {[number, string][]} */
  const cases = [
    [0.0123456, "12.3 mm"], [0.001, "1.00 mm"], [2.5e-6, "0.00250 mm"], [1e-6, "0.00100 mm"],
    [9.87654e-7, "9.88e-4 mm"], [1e-12, "1.00e-9 mm"], [9.9e-13, "<1e-9 mm"], [0, "<1e-9 mm"], [NaN, "missing"],
  ];
  for (const [x, text] of cases) assert.equal(millimetres(x), text);
});

test("depths have one decimal, and may be outside the patient", () => {
  for (const [x, text] of /** @type {const} */ ([[0.12345, "123.5 mm"], [-0.002, "-2.0 mm"], [NaN, "missing"]]))
    assert.equal(depth(x), text);
});

test("the clock of a short run has more decimals", () => {
  for (const [duration, expected] of [[60, 2], [1, 2], [0.5, 3], [0.05, 4], [0, 2]])
    assert.equal(decimals(duration), expected);
});

test("the clock says how long a run is where that is known", () => {
  assert.equal(clockText(0.1234, 0.5), "0.123 / 0.500 s");
  assert.equal(clockText(61.5, null), "61.50 s");
});
