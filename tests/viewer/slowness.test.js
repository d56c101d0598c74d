// Tests: when the page says that the loop is slow.

import assert from "node:assert/strict";
import { test } from "node:test";

import { NO_STATE, Slowness } from "../../rcmqp/show/viewer/assets/slowness.js";

test("a loop is said to be slow from 5 % on, and until less than 2 % are skipped", () => {
  const slowness = new Slowness();
  const found = [0.03, 0.05, 0.051, 0.03, 0.021, 0.019, 0.03].map((skipped) => {
    slowness.see(skipped, 0);
    return slowness.on;
  });
  assert.deepEqual(found, [false, false, true, true, true, false, false]);
});

test("by how much it is slow is told in steps of 5 %, and never as nothing", () => {
  const slowness = new Slowness();
  const found = [0.06, 0.08, 0.47, 0.021].map((skipped) => {
    slowness.see(skipped, 0);
    return slowness.percent;
  });
  assert.deepEqual(found, [5, 10, 45, 5]);
});

test("nothing is said of a loop of which no state comes any more", () => {
  const slowness = new Slowness();
  slowness.see(0.5, NO_STATE - 1);
  assert.ok(slowness.on);
  slowness.see(0.5, NO_STATE);
  assert.ok(!slowness.on);
});
