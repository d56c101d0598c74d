// What hands at the page do to the way of one handle.

import assert from "node:assert/strict";
import { test } from "node:test";

import { Hand, KEYS } from "../../rcmqp/show/viewer/assets/hands.js";

const how = { size: 400, shift: false, at: 7 };

/** @param {number[]} way @param {number[]} expected */
function near(way, expected) {
  expected.forEach((x, i) => assert.ok(Math.abs(way[i] - x) < 1e-9, `${way} is not ${expected}`));
}

/** @param {boolean} pressed @param {number[]} axes */
const pad = (pressed, axes = [0, 0, 0, 0]) => ({ index: 0, axes, buttons: Array.from({ length: 8 }, (_, i) => ({ pressed: i === 5 && pressed })) });

test("a drag moves the hand as far as it goes across the picture", () => {
  const hand = new Hand();
  hand.down(1, [10, 20], "mouse");
  assert.ok(hand.held);
  hand.drag(1, [210, 20], how);
  hand.drag(1, [210, 120], how);
  near(hand.way, [0.04, 0.02, 0, 0]);
  assert.equal(hand.event, 7);
  hand.up(1);
  assert.ok(!hand.held);
  hand.drag(1, [0, 0], how);
  near(hand.way, [0.04, 0.02, 0, 0]);
});

test("with Shift a drag up goes in, and one to the right rolls clockwise", () => {
  const hand = new Hand();
  hand.down(1, [0, 0], "mouse");
  hand.drag(1, [0, -100], { ...how, shift: true });
  near(hand.way, [0, 0, 0.02, 0]);
  hand.drag(1, [100, -100], { ...how, shift: true });
  near(hand.way, [0, 0, 0.02, Math.PI / 4]);
});

test("two fingers pinch, twist and move", () => {
  const hand = new Hand();
  hand.down(1, [0, 0], "mouse");
  hand.down(2, [100, 0], "mouse");
  hand.drag(2, [200, 0], how); // twice as far apart
  near(hand.way, [0.01, 0, 0.03, 0]);
  hand.drag(2, [0, 200], how); // a quarter turn, clockwise in the picture
  near(hand.way, [-0.01, 0.02, 0.03, Math.PI / 2]);
  assert.equal(hand.grip, 1);
});

test("the wheel counts only while something is held", () => {
  const hand = new Hand();
  hand.wheel(-1, 3);
  near(hand.way, [0, 0, 0, 0]);
  hand.down(1, [0, 0], "mouse");
  hand.wheel(-1, 3);
  near(hand.way, [0, 0, 0.004, 0]);
});

test("each time that all was let go, a new grip begins", () => {
  const hand = new Hand();
  hand.down(1, [0, 0], "mouse");
  hand.press("KeyW");
  hand.up(1);
  assert.equal(hand.grip, 1);
  hand.lift("KeyW");
  assert.ok(!hand.held);
  hand.press("KeyW");
  assert.equal(hand.grip, 2);
  assert.ok(!hand.press("KeyX"));
});

test("held keys move the hand with time, each along its axis", () => {
  for (const [code, [axis, way]] of Object.entries(KEYS)) {
    const hand = new Hand();
    hand.press(code);
    hand.tick(0.5, 1);
    assert.deepEqual(hand.way.map(Math.sign), [0, 1, 2, 3].map((i) => (i === axis ? way : 0)));
  }
});

test("a gamepad counts while its shoulder is held, and has to be let go after a stop", () => {
  const hand = new Hand();
  hand.read(pad(true), 1, 1);
  assert.ok(!hand.held); // it was pressed before the page could see it
  hand.read(pad(false, [1, 0, 0, 0]), 1, 1);
  assert.ok(!hand.held);
  hand.read(pad(true, [1, 0, 0, -1]), 1, 1);
  near(hand.way, [0.03, 0, 0.02, 0]);
  hand.read(pad(true, [0.1, 0.1, 0.1, 0.1]), 1, 1); // a stick that does not go back quite
  near(hand.way, [0.03, 0, 0.02, 0]);
  hand.release();
  hand.read(pad(true, [1, 0, 0, 0]), 1, 1);
  assert.ok(!hand.held);
  hand.read(pad(false), 1, 1);
  hand.read(pad(true), 1, 1);
  assert.ok(hand.held);
  assert.equal(hand.grip, 2);
  hand.read(null, 1, 1); // it was unplugged
  assert.ok(!hand.held);
  hand.read(pad(true, [1, 0, 0, 0]), 1, 1); // it is back, with its shoulder pressed
  assert.ok(!hand.held);
  hand.read(pad(false), 1, 1);
  hand.read(pad(true), 1, 1);
  assert.ok(hand.held);
  assert.equal(hand.grip, 3);
});

test("a move to where the pointer already is does not count as input", () => {
  const hand = new Hand();
  hand.down(1, [0, 0], "mouse");
  hand.drag(1, [10, 0], { ...how, at: 5 });
  const way = [...hand.way];
  hand.event = null; // it was sent
  hand.drag(1, [10, 0], { ...how, at: 9 });
  assert.equal(hand.event, null);
  near(hand.way, way);
});

test("after a release nothing that is still down moves the hand", () => {
  const hand = new Hand();
  hand.down(1, [0, 0], "mouse");
  hand.press("KeyW");
  hand.release();
  assert.ok(!hand.held);
  hand.drag(1, [100, 0], how);
  hand.tick(1, 1);
  near(hand.way, [0, 0, 0, 0]);
});

test("what holds has a name, and each name once", () => {
  const hand = new Hand();
  assert.deepEqual(hand.devices, []);
  hand.down(1, [0, 0], "touch");
  hand.down(2, [9, 0], "touch");
  hand.drag(1, [5, 5], { size: 100, shift: false, at: 1 });
  assert.deepEqual(hand.devices, ["touch"]);
  hand.press("KeyW");
  hand.press("ArrowUp");
  hand.read(pad(false), 1, 1);
  hand.read(pad(true), 1, 1);
  for (const device of ["left controller", "right controller", "space mouse", "haply"]) {
    hand.grasp(device, false);
    hand.grasp(device, true);
  }
  assert.deepEqual(hand.devices, ["touch", "keys", "gamepad", "headset", "space mouse", "haply"]);
  hand.release();
  assert.deepEqual(hand.devices, []);
});
