// When the server is told of the hand, by a clock that the test sets.

import assert from "node:assert/strict";
import { test } from "node:test";

import { Hand } from "../../rcmqp/show/viewer/assets/hands.js";
import { EVERY, LEAST, Teller } from "../../rcmqp/show/viewer/assets/teller.js";

/** A page whose clock the test sets; as in a browser, a delay is cut to whole milliseconds. */
function page() {
  const hand = new Hand();
  /** @type {[number, boolean, number | null][]} */
  const sent = [];
  /** @type {[number, () => void][]} */
  let timers = [];
  const state = {
    hand, sent, steers: true, now: 1000, offset: 0,
    /** Set the clock, and let the timers run that are due. @param {number} now [ms] */
    at(now) {
      for (let runs = 0; ; runs += 1) {
        assert.ok(runs < 100, "timers that never end");
        const timer = timers.filter(([due]) => due <= now).sort(([a], [b]) => a - b)[0];
        if (!timer) break;
        timers = timers.filter((each) => each !== timer);
        state.now = Math.max(state.now, timer[0]);
        timer[1]();
      }
      state.now = now;
    },
  };
  const send = () => {
    sent.push([state.now, hand.held, hand.event]);
    hand.event = null;
  };
  const clock = { now: () => state.now, later: (/** @type {() => void} */ then, /** @type {number} */ delay) => void timers.push([state.now + Math.floor(delay), then]) };
  return { ...state, at: state.at, state, teller: new Teller(hand, { steers: () => state.steers, send }, clock) };
}

/** A page whose hand was held at 1000 ms, which it told of, and moved 1 ms later. */
function movedSoon() {
  const held = page();
  held.hand.down(1, [0, 0], "mouse");
  held.teller.changed();
  held.at(1001);
  held.hand.drag(1, [10, 0], { size: 400, shift: false, at: 1001 });
  held.teller.changed();
  return held;
}

/** Times from each to the next. @param {[number, ...any][]} sent */
const gaps = (sent) => sent.slice(1).map(([at], i) => at - sent[i][0]);

test("a mouse at 8 kHz is told of 250 times a second at most, and that it is let go at once", () => {
  const { hand, sent, teller, at } = page();
  hand.down(1, [0, 0], "mouse");
  teller.changed();
  for (let k = 1; k <= 8000; k += 1) {
    at(1000 + k / 8);
    hand.drag(1, [k, 0], { size: 400, shift: false, at: 1000 + k / 8 });
    teller.changed();
    if (k % (8 * EVERY) === 0) teller.tick();
  }
  assert.ok(sent.length <= 1000 / LEAST + 1, `${sent.length}`);
  assert.ok(sent.length > 0.75 * (1000 / LEAST), `${sent.length}`);
  assert.ok(gaps(sent).every((gap) => gap >= LEAST), `${Math.min(...gaps(sent))}`);
  at(2000.1);
  hand.up(1);
  teller.changed();
  assert.deepEqual(sent.at(-1)?.slice(0, 2), [2000.1, false]);
});

test("an input soon after a message is told of as soon as may be, with nothing more to come", () => {
  const { sent, at } = movedSoon();
  assert.equal(sent.length, 1);
  at(1000 + 2 * LEAST);
  assert.deepEqual(sent, [[1000, true, null], [1000 + LEAST, true, 1001]]);
});

test("a timer that finds that another message has just gone waits once more", () => {
  const { hand, sent, teller, at } = movedSoon();
  at(1003);
  teller.tell();
  hand.drag(1, [20, 0], { size: 400, shift: false, at: 1003 });
  teller.changed();
  at(1020);
  assert.deepEqual(sent.map(([time]) => time), [1000, 1003, 1007]);
});

test("a hand that is held still is told of from time to time, one that is let go once, and a watcher's never", () => {
  const { hand, sent, teller, state, at } = page();
  hand.press("KeyW");
  teller.changed();
  for (let k = 1; k <= 10; k += 1) {
    at(1000 + EVERY * k);
    teller.tick();
  }
  assert.equal(sent.length, 11);
  hand.lift("KeyW");
  for (let k = 11; k <= 20; k += 1) {
    at(1000 + EVERY * k);
    teller.tick();
  }
  assert.deepEqual(sent.slice(11).map(([, held]) => held), [false]);
  state.steers = false;
  hand.press("KeyW");
  at(2000);
  teller.changed();
  assert.equal(sent.length, 12);
});
