// When gamepads are looked for, and which one steers.

import assert from "node:assert/strict";
import { test } from "node:test";

import { Gamepad, TICKS_BETWEEN_LOOKS } from "../../rcmqp/show/viewer/assets/gamepad.js";
import { Hand } from "../../rcmqp/show/viewer/assets/hands.js";

/** @param {boolean} pressed @param {number} index */
const pad = (pressed, index = 0) => ({ index, axes: [1, 0, 0, 0], buttons: Array.from({ length: 8 }, (_, i) => ({ pressed: i === 5 && pressed })) });

function gamepad() {
  const hand = new Hand();
  const state = { pads: /** @type {(ReturnType<typeof pad> | null)[]} */ ([null, null]), looks: 0 };
  const device = new Gamepad(hand, () => {
    state.looks += 1;
    return state.pads;
  });
  return { hand, state, tick: () => device.tick(0.016, 7) };
}

test("without a gamepad, the page looks for one after each pause, and finds it", () => {
  const { hand, state, tick } = gamepad();
  tick();
  assert.equal(state.looks, 1);
  state.pads = [null, pad(false)];
  for (let k = 0; k < TICKS_BETWEEN_LOOKS; k += 1) tick();
  assert.equal(state.looks, 1);
  tick();
  assert.equal(state.looks, 2);
  state.pads = [null, pad(true)];
  tick();
  assert.ok(hand.held);
});

test("a gamepad that is lost lets go at the next tick", () => {
  const { hand, state, tick } = gamepad();
  state.pads = [pad(false)];
  tick();
  state.pads = [pad(true)];
  tick();
  assert.ok(hand.held);
  state.pads = [null];
  tick();
  assert.ok(!hand.held);
});

test("another gamepad whose shoulder is pressed has to be let go first", () => {
  const { hand, state, tick } = gamepad();
  for (const pads of [[pad(false)], [pad(true)], [null, pad(true, 1)]]) {
    state.pads = pads;
    tick();
  }
  assert.ok(!hand.held);
  const way = [...hand.way];
  tick();
  assert.deepEqual(hand.way, way);
  state.pads = [null, pad(false, 1)];
  tick();
  state.pads = [null, pad(true, 1)];
  tick();
  assert.ok(hand.held);
});
