import assert from "node:assert/strict";
import { test } from "node:test";

import { LiveSource, RecordedSource } from "../../rcmqp/show/viewer/assets/sources.js";

/** The state of an arm of two joints at a time: every number is a multiple of it. @param {number} t */
const state = (t) => ({
  angles: [t, -t], tip: [t, 2 * t, 3 * t], tip_d: [t, 2 * t, 3.1 * t], pivot: [0, 0, 0.1 * t],
  slip: [0, 1e-3 * t, 0], tip_error: [0.1 * t], depth: [0.2 * t],
});

/** @param {number[]} times */
function recorded(times) {
  const states = times.map(state);
  /** @param {keyof ReturnType<typeof state>} name */
  const column = (name) => new Float64Array(states.flatMap((each) => each[name]));
  const names = /** @type {(keyof ReturnType<typeof state>)[]} */ (Object.keys(state(0)));
  const columns = Object.fromEntries(names.map((name) => [name, column(name)]));
  return new RecordedSource(/** @type {import("../../rcmqp/show/viewer/assets/sources.js").Frames} */ ({ time: new Float64Array(times), ...columns }));
}

/** @param {number[]} times */
function live(times, options = {}) {
  const source = new LiveSource(2, options);
  for (const t of times) assert.ok(source.push(t, state(t)));
  return source;
}

/** @param {import("../../rcmqp/show/viewer/assets/sources.js").State} found @param {number} t */
function assertState(found, t) {
  for (const [name, expected] of Object.entries(state(t)))
    Array.from(expected).forEach((x, i) => assert.ok(Math.abs(found[/** @type {"tip"} */ (name)][i] - x) < 1e-12, `${name} at ${t} s`));
}

const TIMES = [0, 0.5, 1.5, 2];

for (const [name, make] of /** @type {const} */ ([["recorded", recorded], ["live", live]])) {
  test(`${name}: between two frames all goes straight, outside it stays at the ends`, () => {
    const source = make(TIMES);
    assert.equal(source.newest, 2);
    for (const t of [0, 0.25, 0.5, 1.3, 2]) assertState(source.at(t), t);
    assertState(source.at(-1), 0);
    assertState(source.at(99), 2);
  });

  test(`${name}: one frame alone is the state at any time`, () => {
    for (const t of [-1, 3, 4]) assertState(make([3]).at(t), 3);
  });

  test(`${name}: trails are those of the tip and of the desired tip`, () => {
    const source = make(TIMES);
    assert.deepEqual([...source.trail("tip").points], TIMES.flatMap((t) => state(t).tip));
    assert.deepEqual([...source.trail("tip_d").points], TIMES.flatMap((t) => state(t).tip_d));
  });

  test(`${name}: the cameras see where tip and trocar have been`, () => {
    const expected = TIMES.flatMap((t) => [state(t).tip, state(t).pivot]);
    assert.deepEqual(make(TIMES).visited(), expected);
    const many = make(Array.from({ length: 500 }, (_, i) => i));
    assert.ok(many.visited().length <= 300);
  });
}

test("a recording has a duration, what is live has none", () => {
  assert.equal(recorded(TIMES).duration, 2);
  assert.equal(live(TIMES).duration, null);
});

test("a missing number does not reach into frames that have it", () => {
  const source = new LiveSource(2);
  source.push(0, state(0));
  source.push(1, { ...state(1), tip_error: [NaN], tip: [NaN, NaN, NaN] });
  source.push(2, state(2));
  assertState(source.at(0), 0);
  assertState(source.at(2), 2);
  assert.ok(Number.isNaN(source.at(0.5).tip_error[0]));
  assert.ok(Number.isNaN(source.at(1).tip_error[0]));
  assert.equal(source.at(1).depth[0], 0.2);
  assert.equal(source.trail("tip").count, 2);
  assert.equal(source.visited().length, 5);
});

test("what is live has no newest frame before the first", () => {
  assert.ok(Number.isNaN(new LiveSource(2).newest));
});

test("a frame that is not newer is left out", () => {
  const source = live([1, 2]);
  for (const t of [2, 1.5, -3]) assert.equal(source.push(t, state(t)), false);
  assert.equal(source.newest, 2);
  assertState(source.at(1.5), 1.5);
});

test("a frame of another arm, or without a time, is refused", () => {
  const source = live([1]);
  assert.throws(() => source.push(2, { ...state(2), angles: [1, 2, 3] }), /angles has 3 numbers, it must have 2/);
  for (const t of [NaN, Infinity]) assert.throws(() => source.push(t, state(1)), /must be finite/);
  assert.equal(source.newest, 1);
  assert.equal(source.trail("tip").count, 1);
});

test("an hour at 60 Hz takes no more memory than the first seconds, and time keeps its resolution", () => {
  const source = new LiveSource(2);
  const buffers = () => [source.history, source.trails.tip.history, source.trails.tip_d.history].map(({ columns }) =>
    Object.values(columns).map(({ buffer }) => buffer.byteLength));
  const before = buffers();
  for (let i = 0; i < 216000; i++) source.push(i / 60, state(i / 60));
  assert.deepEqual(buffers(), before);
  for (let i = 0; i < 300; i++) assertState(source.at((215999 - i) / 60), (215999 - i) / 60); // five seconds back
  assert.ok(source.trail("tip").count >= 2000);
  const { points } = source.trail("tip");
  assert.deepEqual([...points.slice(-3)], state(215999 / 60).tip);
});

test("a source whose clock starts again takes frames from there", () => {
  const source = live([5, 6]);
  source.clear();
  assert.ok(Number.isNaN(source.newest));
  assert.ok(source.push(0, state(0)));
  assertState(source.at(6), 0);
  assert.equal(source.trail("tip").count, 1);
  assert.equal(source.trail("tip_d").count, 1);
});
