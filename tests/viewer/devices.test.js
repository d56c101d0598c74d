// A headset's controllers, a space mouse and a Haply, played by stand-ins: what they say moves the hand while they hold.

import assert from "node:assert/strict";
import { test } from "node:test";

import { Controllers } from "../../rcmqp/show/viewer/assets/controllers.js";
import { Hand } from "../../rcmqp/show/viewer/assets/hands.js";
import { Haply } from "../../rcmqp/show/viewer/assets/haply.js";
import { SpaceMouse } from "../../rcmqp/show/viewer/assets/spacemouse.js";
import { turnAbout } from "../../rcmqp/show/viewer/assets/vectors.js";

/** @param {number[]} way @param {number[]} expected */
function near(way, expected) {
  assert.equal(way.length, expected.length);
  expected.forEach((x, i) => assert.ok(Math.abs(way[i] - x) < 1e-9, `${way} is not ${expected}`));
}

/** A turn about an axis as x, y, z, w. @param {number[]} axis @param {number} angle [rad] */
const turn = (axis, angle) => [...axis.map((x) => x * Math.sin(angle / 2)), Math.cos(angle / 2)];

/** @param {number} reportId @param {number[]} numbers */
const report = (reportId, numbers) => ({ reportId, data: new DataView(Int16Array.from(numbers).buffer) });
/** @param {number} pressed */
const buttons = (pressed) => ({ reportId: 3, data: new DataView(Uint8Array.of(pressed, 0).buffer) });

function spaceMouse() {
  const hand = new Hand();
  const mouse = new SpaceMouse(hand, () => {});
  mouse.tick(0.01, 1);
  return { hand, mouse };
}

test("the turn about an axis is found, whatever the other turns and signs", () => {
  const from = turn([0, 0.6, 0.8], 2);
  const [x, y, z, w] = from;
  for (const angle of [-3, -0.2, 0, 1, 3]) { // to = turn * from, about z
    const [s, c] = [Math.sin(angle / 2), Math.cos(angle / 2)];
    const to = [c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z];
    near([turnAbout([0, 0, 1], from, to)], [angle]);
    near([turnAbout([0, 0, 1], from, to.map((value) => -value))], [angle]);
    near([turnAbout([0, 0, -1], from, to)], [-angle]);
  }
});

test("a space mouse moves the hand while a button is held, each axis to its own", () => {
  for (const [id, numbers, way] of /** @type {[number, number[], number[]][]} */ ([
    [1, [350, 0, 0], [0.03, 0, 0, 0]], // to the right
    [1, [0, 0, 350], [0, 0.03, 0, 0]], // down
    [1, [0, -350, 0], [0, 0, 0.02, 0]], // away from the user: in
    [2, [0, -350, 0], [0, 0, 0, 0.6]], // clockwise, as the user sees it
    [1, [0, 0, 0, 0, -175, 0], [0, 0, 0, 0.3]], // newer ones
    [1, [5000, 0, 0], [0.03, 0, 0, 0]],
    [1, [20, 0, 0], [0, 0, 0, 0]], // it does not go back quite
  ])) {
    const { hand, mouse } = spaceMouse();
    mouse.hear(report(id, numbers), 0);
    mouse.tick(1, 1);
    near(hand.way, [0, 0, 0, 0]);
    mouse.hear(buttons(1), 0);
    assert.ok(hand.held);
    mouse.tick(1, 1);
    near(hand.way, way);
    mouse.hear(buttons(0), 0);
    assert.ok(!hand.held);
  }
});

test("a space mouse that is unplugged, or was pressed at a release, holds nothing", () => {
  const { hand, mouse } = spaceMouse();
  mouse.hear(buttons(2), 0);
  hand.release();
  mouse.hear(report(1, [350, 0, 0]), 0);
  mouse.tick(1, 1);
  assert.ok(!hand.held);
  near(hand.way, [0, 0, 0, 0]);
  mouse.hear(buttons(0), 0);
  mouse.hear(buttons(2), 0);
  assert.ok(hand.held);
  assert.equal(hand.grip, 2);
  mouse.gone();
  mouse.tick(1, 1);
  assert.ok(!hand.held);
  near(hand.way, [0, 0, 0, 0]);
});

test("a space mouse whose cap was pushed when it fell silent lets go, and has to be let go and pressed anew", () => {
  for (const numbers of [[350, 0, 0], [0, 0, 0, 0, 350, 0]]) {
    const { hand, mouse } = spaceMouse();
    mouse.hear(buttons(1), 0);
    mouse.hear(report(1, numbers), 0);
    for (let at = 10; at <= 10000; at += 10) mouse.tick(0.01, at); // out of reach for 10 s
    assert.ok(!hand.held);
    assert.ok(Math.abs(hand.way[0]) < 0.0031 && Math.abs(hand.way[3]) < 0.061, `${hand.way}`);
    const stayed = [...hand.way];
    mouse.hear(report(1, numbers), 10000);
    mouse.tick(0.01, 10010);
    assert.ok(!hand.held);
    mouse.hear(buttons(0), 10020);
    mouse.hear(buttons(1), 10030);
    mouse.tick(0.01, 10040);
    assert.ok(hand.held);
    assert.notDeepEqual(hand.way, stayed);
  }
});

test("a space mouse that is held still sends nothing, and stays held", () => {
  const { hand, mouse } = spaceMouse();
  mouse.hear(report(1, [20, 0, 0]), 0); // it does not go back quite
  mouse.hear(buttons(1), 0);
  mouse.tick(0.01, 5000);
  assert.ok(hand.held);
  mouse.hear(report(1, [350, 0, 0]), 5010);
  mouse.tick(0.01, 5020);
  near(hand.way, [0.0003, 0, 0, 0]);
});

test("a space mouse that was allowed before is listened to, and a report that is too short is left out", async () => {
  const hand = new Hand();
  const device = Object.assign(new EventTarget(), { opened: false, async open() { this.opened = true; } });
  const hid = Object.assign(new EventTarget(), { getDevices: async () => [device], requestDevice: async () => [device] });
  const mouse = new SpaceMouse(hand, () => {});
  await mouse.resume(hid);
  await mouse.connect(hid); // it listens once
  mouse.tick(0.01, 1);
  device.dispatchEvent(Object.assign(new Event("inputreport"), report(1, [9])));
  device.dispatchEvent(Object.assign(new Event("inputreport"), buttons(1)));
  assert.ok(hand.held);
  hid.dispatchEvent(new Event("disconnect"));
  assert.ok(!hand.held);
});

/** A stand-in for the service's socket, and what it was sent. */
class Socket extends EventTarget {
  /** @type {any[]} */
  sent = [];
  closed = false;

  close() { this.closed = true; }

  /** @param {string} text */
  send(text) { this.sent.push(JSON.parse(text)); }
}

function haply(viscosity = 15) {
  const [hand, socket, said] = [new Hand(), new Socket(), /** @type {string[]} */ ([])];
  const device = new Haply(hand, { changed() {}, viscosity: () => viscosity, said: (words) => said.push(words) });
  device.socket = /** @type {any} */ (socket);
  return { hand, socket, device, said };
}

/** @param {number[]} place @param {{pressed?: boolean, q?: number[], v?: number[]}} more */
function message([x, y, z], { pressed = true, q = [0, 0, 0, 1], v = [0, 0, 0] } = {}) {
  const [a, b, c, w] = q;
  return {
    inverse3: [{ device_id: "0F", state: { cursor_position: { x, y, z }, cursor_velocity: { x: v[0], y: v[1], z: v[2] } } }],
    wireless_verse_grip: [{ state: { buttons: { a: pressed, b: false, c: false }, orientation: { x: a, y: b, z: c, w } } }],
  };
}

test("a Haply moves the hand as far as its handle goes while a button is held", () => {
  const { hand, device } = haply();
  device.hear(message([0, 0, 0], { pressed: false }), 1);
  device.hear(message([0.5, 0, 0]), 2); // where it is taken hold of is the origin
  device.hear(message([0.51, 0.02, 0.03], { q: turn([0, 1, 0], 0.4) }), 3);
  near(hand.way, [0.01, -0.03, 0.02, 0.4]);
  assert.ok(hand.felt);
  assert.equal(hand.event, 3);
  device.hear(message([0.6, 0, 0], { pressed: false }), 4);
  assert.ok(!hand.held);
  assert.ok(!hand.felt);
  device.hear(message([0.7, 0, 0]), 5);
  near(hand.way, [0.01, -0.03, 0.02, 0.4]);
});

test("a Haply renders the viscosity, and not more than 5 N", () => {
  const { socket, device } = haply();
  device.hear(message([0, 0, 0], { v: [0.1, -0.2, 0] }), 1);
  device.hear(message([0, 0, 0], { v: [0, 0, 2] }), 2);
  const forces = socket.sent.map(({ inverse3: [{ device_id, commands }] }) => {
    assert.equal(device_id, "0F");
    const { x, y, z } = commands.set_cursor_force.values;
    return [x, y, z];
  });
  near(forces[0], [-1.5, 3, 0]);
  near(forces[1], [0, 0, -5]);
});

test("a Haply that falls silent lets go, and has to be let go and pressed anew", () => {
  const { hand, device } = haply();
  device.hear(message([0, 0, 0], { pressed: false }), 1);
  device.hear(message([0, 0, 0]), 2);
  device.tick(102);
  assert.ok(hand.held);
  device.tick(103);
  assert.ok(!hand.held);
  device.hear(message([0.1, 0, 0]), 200);
  assert.ok(!hand.held);
  device.hear(message([0.1, 0, 0], { pressed: false }), 201);
  device.hear(message([0.2, 0, 0]), 202);
  assert.ok(hand.held);
  near(hand.way, [0, 0, 0, 0]);
});

test("of several hands only a Haply alone feels the viscosity", () => {
  const { hand, device } = haply();
  device.hear(message([0, 0, 0], { pressed: false }), 1);
  device.hear(message([0, 0, 0]), 2);
  assert.ok(hand.felt);
  hand.down(1, [0, 0], "mouse");
  assert.ok(!hand.felt);
  hand.up(1);
  assert.ok(hand.felt);
  hand.press("KeyW");
  assert.ok(!hand.felt);
});

test("a Haply that sends what is not understood, or whose handle jumps, lets go and says so", () => {
  const at = (/** @type {any} */ cursor_position) => JSON.stringify({ inverse3: [{ device_id: "0F", state: { cursor_position } }] });
  for (const odd of [
    "", "null", "{}", '{"inverse3": []}', '{"inverse3": null}', '{"inverse3": 7}', at(null), '{"inverse3": [{"state": {}}], "verse_grip": null}',
    JSON.stringify(message([0, NaN, 0])), JSON.stringify(message([50, 0, 0])), JSON.stringify(message([0, 0.06, 0])), JSON.stringify(message([0, 0, 0], { q: turn([0, 1, 0], 1) })),
  ]) {
    const { hand, device, said, socket } = haply();
    device.read(JSON.stringify(message([0, 0, 0], { pressed: false })), 1);
    device.read(JSON.stringify(message([0, 0, 0])), 2);
    assert.ok(hand.held);
    device.read(odd, 3);
    assert.ok(!hand.held, odd);
    assert.equal(said.length, 1, odd);
    assert.equal(socket.sent.length, 3, odd); // each was answered once: the service waits for that
    assert.equal(socket.sent[2].inverse3[0].device_id, "0F", odd);
    device.read(JSON.stringify(message([0, 0, 0])), 4);
    assert.ok(!hand.held, odd);
    near(hand.way, [0, 0, 0, 0]);
    device.read(JSON.stringify(message([0, 0, 0], { pressed: false })), 5);
    device.read(JSON.stringify(message([0, 0, 0])), 6);
    assert.ok(hand.held, odd);
  }
});

test("messages of a Haply without a place, or with one that is no number, hold nothing", () => {
  const { hand, device } = haply();
  device.hear(message([0, 0, 0], { pressed: false }), 1);
  for (const odd of [{}, { inverse3: [] }, { inverse3: [{ device_id: "0F", state: {} }], wireless_verse_grip: message([0, 0, 0]).wireless_verse_grip }])
    device.read(JSON.stringify(odd), 2);
  device.read(JSON.stringify(message([0, NaN, 0])), 3);
  assert.ok(!hand.held);
});

/** A Haply that connects to stand-ins for the service, as the page's button does. */
function connected() {
  /** @type {Socket[]} */
  const sockets = [];
  class Connected extends Socket {
    constructor() {
      super();
      sockets.push(this);
    }
  }
  const kept = new Map();
  Object.assign(globalThis, {
    WebSocket: Connected,
    sessionStorage: { setItem: (/** @type {string} */ key, /** @type {string} */ value) => kept.set(key, value), removeItem: (/** @type {string} */ key) => kept.delete(key) },
  });
  const { hand, device, said } = haply();
  device.socket = null;
  device.connect();
  sockets[0].dispatchEvent(new Event("open"));
  return { hand, device, said, sockets, kept };
}

/** @param {Socket} socket @param {unknown} data */
const say = (socket, data) => socket.dispatchEvent(new MessageEvent("message", { data: JSON.stringify(data) }));

test("a service without a device is left, so that the page's button connects again once it is switched on", () => {
  const { hand, device, said, sockets, kept } = connected();
  say(sockets[0], { inverse3: [] });
  assert.ok(sockets[0].closed);
  assert.equal(kept.size, 0);
  assert.match(said.at(-1) ?? "", /switched on/);
  device.connect();
  sockets[0].dispatchEvent(new Event("close")); // it comes late
  assert.equal(said.length, 1);
  assert.equal(sockets.length, 2);
  say(sockets[1], message([0, 0, 0], { pressed: false }));
  say(sockets[1], message([0, 0, 0]));
  assert.ok(hand.held);
});

test("a connection that ends lets go, and the next service may have another device or none", () => {
  const { hand, device, said, sockets } = connected();
  say(sockets[0], message([0, 0, 0], { pressed: false }));
  say(sockets[0], message([0, 0, 0]));
  assert.ok(hand.held);
  sockets[0].dispatchEvent(new Event("close"));
  assert.ok(!hand.held);
  assert.match(said.at(-1) ?? "", /is its service running/);
  device.connect();
  say(sockets[1], { inverse3: [] });
  assert.deepEqual(sockets[1].sent, []);
  assert.ok(sockets[1].closed);
});

test("a Haply that cannot be answered has let go before", () => {
  const { hand, device, socket } = haply();
  device.hear(message([0, 0, 0], { pressed: false }), 1);
  device.hear(message([0, 0, 0]), 2);
  assert.ok(hand.held);
  socket.send = () => { throw new Error("it is closing"); };
  assert.throws(() => device.read("", 3), /closing/);
  assert.ok(!hand.held);
});

/** A right controller whose trigger is pressed or not. @param {boolean} pressed */
const right = (pressed) => [{ handedness: "right", gripSpace: {}, gamepad: { buttons: [{ pressed }] } }];
/** @param {number} x @param {boolean} emulatedPosition */
const pose = (x, emulatedPosition = false) =>
  () => ({ transform: { position: { x, y: 0, z: 0, w: 1 }, orientation: { x: 0, y: 0, z: 0, w: 1 } }, emulatedPosition });

function controllers() {
  const hand = new Hand();
  const each = new Controllers(hand, () => {});
  each.read(right(false), pose(0), 1);
  each.read(right(true), pose(0), 10);
  each.read(right(true), pose(0.01), 20);
  assert.ok(hand.held);
  near(hand.way, [0.01, 0, 0, 0]);
  return { hand, each };
}

test("a controller whose place is a guess, or that is gone, lets go, and has to be let go and pressed anew", () => {
  for (const lost of [pose(0.31, true), () => null, () => undefined]) {
    const { hand, each } = controllers();
    each.read(right(true), lost, 30);
    assert.ok(!hand.held);
    each.read(right(true), pose(0.3), 40);
    assert.ok(!hand.held);
    each.read(right(false), pose(0.3), 50);
    each.read(right(true), pose(0.3), 60);
    assert.ok(hand.held);
    each.read(right(true), pose(0.31), 70);
    near(hand.way, [0.02, 0, 0, 0]);
  }
});

test("a controller that is not read any more, as no picture is drawn, lets go", () => {
  const { hand, each } = controllers();
  each.tick(120);
  assert.ok(hand.held);
  each.tick(121);
  assert.ok(!hand.held);
  each.read(right(true), pose(0.3), 500);
  assert.ok(!hand.held);
  each.read(right(false), pose(0.3), 510);
  each.read(right(true), pose(0.3), 520);
  assert.ok(hand.held);
  near(hand.way, [0.01, 0, 0, 0]);
});
