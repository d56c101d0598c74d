import assert from "node:assert/strict";
import { test } from "node:test";

import { Clock } from "../../rcmqp/show/viewer/assets/clock.js";

/** A source as far as a clock sees it. @param {number | null} duration @param {number} newest */
const source = (duration, newest = duration ?? NaN) =>
  /** @type {import("../../rcmqp/show/viewer/assets/sources.js").FrameSource} */ (/** @type {unknown} */ ({ duration, newest }));

test("the clock is as long as the longest recording", () => {
  const clock = new Clock([source(2), source(5), source(3)]);
  assert.deepEqual([clock.duration, clock.end], [5, 5]);
});

test("a time outside the recording becomes the nearest one inside", () => {
  const clock = new Clock([source(5)]);
  for (const [t, expected] of [[3, 3], [-1, 0], [7, 5]]) {
    clock.seek(t);
    assert.equal(clock.time, expected);
  }
});

test("it plays at its speed, and stays where it is while it does not", () => {
  const clock = new Clock([source(5)]);
  clock.tick(0.1);
  assert.equal(clock.time, 0);
  clock.play();
  clock.speed = 4;
  clock.tick(0.1);
  assert.equal(clock.time, 0.4);
  clock.pause();
  clock.tick(0.1);
  assert.equal(clock.time, 0.4);
});

test("a page that was out of sight does not jump on", () => {
  const clock = new Clock([source(5000)]);
  clock.play();
  clock.tick(600);
  assert.equal(clock.time, 2);
});

test("playing ends at the end, and starts again from the beginning", () => {
  const clock = new Clock([source(1)]);
  clock.play();
  clock.tick(1.5);
  assert.deepEqual([clock.time, clock.playing], [1, false]);
  clock.play();
  assert.deepEqual([clock.time, clock.playing], [0, true]);
});

test("with what is live the duration is unknown, and playing follows the newest frame", () => {
  const arm = source(null, NaN);
  const clock = new Clock([arm]);
  assert.deepEqual([clock.duration, clock.end], [null, 0]);
  clock.play();
  for (const newest of [0.1, 0.4, 70]) {
    arm.newest = newest;
    clock.tick(1 / 60);
    assert.deepEqual([clock.time, clock.playing], [newest, true]);
  }
  clock.pause();
  arm.newest = 80;
  clock.tick(1 / 60);
  assert.equal(clock.time, 70); // held, to look at it
  clock.play();
  assert.equal(clock.time, 70);
  clock.tick(1 / 60);
  assert.equal(clock.time, 80);
});
