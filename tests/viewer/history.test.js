import assert from "node:assert/strict";
import { test } from "node:test";

import { History, place } from "../../rcmqp/show/viewer/assets/history.js";

test("a time falls between two rows, and outside it is at the first or last", () => {
  const times = new Float64Array([1, 2, 4, 8]);
  for (const [t, row, share] of [[0, 0, 0], [1, 0, 0], [1.25, 0, 0.25], [2, 1, 0], [3, 1, 0.5], [7, 2, 0.75], [8, 3, 0], [9, 3, 0]])
    assert.deepEqual(place(times, t), [row, share], `at ${t}`);
  assert.deepEqual(place(new Float64Array([5]), 7), [0, 0]);
});

test("every time in a long array is found as a plain search finds it", () => {
  const times = Float64Array.from({ length: 1000 }, (_, i) => i + 0.3 * Math.sin(7 * i));
  for (let t = -1; t < 1001; t += 0.37) {
    const [row, share] = place(times, t);
    const before = times.findLastIndex((time) => time <= t);
    assert.equal(row, Math.max(0, before));
    const inside = before >= 0 && before < 999;
    const expected = inside ? (t - times[before]) / (times[before + 1] - times[before]) : 0;
    assert.ok(Math.abs(share - expected) < 1e-12);
  }
});

test("rows come back as they were pushed", () => {
  const history = new History({ time: 1, point: 3 }, 4);
  history.push({ time: [1], point: [1, 2, 3] });
  history.push({ time: [2], point: new Float32Array([4, 5, 6]) });
  assert.deepEqual([...history.column("time")], [1, 2]);
  assert.deepEqual([...history.column("point")], [1, 2, 3, 4, 5, 6]);
});

for (const rows of [2, 3, 4, 7, 600])
  test(`of ${rows} rows the newest half at least is there, in order and in one piece`, () => {
    const history = new History({ time: 1, pair: 2 }, rows);
    const memory = history.columns.pair;
    for (let i = 1; i <= 5 * rows + 1; i++) {
      history.push({ time: [i], pair: [2 * i, -i] });
      assert.equal(history.count + history.dropped, i);
      assert.ok(history.count <= rows && history.count >= Math.min(i, Math.floor(rows / 2)));
      const expected = Array.from({ length: history.count }, (_, k) => i - history.count + 1 + k);
      assert.deepEqual([...history.column("time")], expected);
      assert.deepEqual([...history.column("pair")], expected.flatMap((k) => [2 * k, -k]));
    }
    assert.equal(history.columns.pair, memory);
  });

test("half is dropped at once, so that few pushes move what is kept", () => {
  const history = new History({ time: 1 }, 100);
  for (let i = 0; i < 101; i++) history.push({ time: [i] });
  assert.deepEqual([history.count, history.dropped], [51, 50]);
});

test("a row of another size is refused, and nothing of it is kept", () => {
  const history = new History({ time: 1, point: 3 }, 4);
  history.push({ time: [1], point: [1, 2, 3] });
  assert.throws(() => history.push({ time: [2], point: [1, 2] }), /point has 2 numbers, it must have 3/);
  // @ts-expect-error: a column is missing
  assert.throws(() => history.push({ time: [2] }), /point has no numbers, it must have 3/);
  assert.deepEqual([...history.column("time")], [1]);
});

test("a history without room is refused", () => {
  for (const rows of [0, 1, 2.5, NaN]) assert.throws(() => new History({ time: 1 }, rows), /2 or more/);
});

test("a cleared history counts what it had as dropped", () => {
  const history = new History({ time: 1 }, 4);
  history.push({ time: [1] });
  history.clear();
  assert.deepEqual([history.count, history.dropped], [0, 1]);
  assert.equal(history.column("time").length, 0);
});
