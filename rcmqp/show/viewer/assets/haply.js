// Haply's Inverse3, by the JSON of its service: the handle moves the hand, and feels the viscosity.

import { SILENCE } from "./hands.js";
import { turnAbout } from "./vectors.js";

/** Where its service listens. */
export const SERVICE = "ws://localhost:10001";
/** From one message to the next a handle goes and turns less [m], [rad]: at 1 kHz a fast hand makes 1 mm. */
const [JUMP, TURN] = [0.05, 0.5];
/** The largest force that is asked for [N]. */
const STRONGEST = 5;

/** What a tab keeps over its pages: that it has listened to one. */
const REMEMBERED = "haply";

/** @typedef {{x: number, y: number, z: number, w?: number}} Xyz */

/** @param {Xyz | undefined} values */
const array = ({ x, y, z, w = 0 } = { x: NaN, y: NaN, z: NaN }) => [x, y, z, w];

export class Haply {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {{changed: () => void, viscosity: () => number, said: (words: string) => void}} page
   *   changed() after each message, the viscosity to be felt [N s/m], and what the user has to know
   */
  constructor(hand, page) {
    this.hand = hand;
    this.page = page;
    /** @type {WebSocket | null} */
    this.socket = null;
    /** Where the handle was while it was held, and its attitude. @type {[number[], number[]] | null} */
    this.before = null;
    this.heard = 0;
    this.silent = false;
    /** The device that the service spoke of last. */
    this.device = "";
    this.answered = 0;
  }

  /** Go on after a page of this tab that listened to one. */
  resume() {
    if (sessionStorage.getItem(REMEMBERED) !== null) this.connect();
  }

  /** @param {string} address of the service */
  connect(address = SERVICE) {
    if (this.socket) return;
    const socket = this.socket = new WebSocket(address);
    socket.addEventListener("message", ({ data }) => this.read(data, performance.now()));
    socket.addEventListener("open", () => sessionStorage.setItem(REMEMBERED, ""));
    socket.addEventListener("close", () => {
      if (this.socket !== socket) return; // it was left before
      this.leave();
      this.page.said(`no Haply at ${address}: is its service running?`);
    });
  }

  /** Listen no more; connect() begins anew. */
  leave() {
    const socket = this.socket;
    this.socket = null;
    this.device = "";
    sessionStorage.removeItem(REMEMBERED);
    this.letGo();
    socket?.close();
  }

  /**
   * Take a message of the service. If it cannot be read, the hand lets go and the answer has no force.
   * If it names no device, the connection is closed, and the user has to connect again.
   *
   * @param {string} text
   * @param {number} at [ms]
   */
  read(text, at) {
    const before = this.answered;
    try {
      this.hear(JSON.parse(text), at);
    } catch (error) {
      this.letGo();
      if (!this.device) this.leave();
      else if (this.answered === before) this.answer([0, 0, 0]);
      this.page.said(`a message of the Haply's service is not understood: ${error instanceof Error ? error.message : error}`);
    }
  }

  /**
   * A message of the service: x to the right, y away from the user, z up.
   *
   * @param {{inverse3?: any[], wireless_verse_grip?: any[], verse_grip?: any[]}} message
   * @param {number} at [ms]
   * @throws {TypeError | RangeError} if it has other fields, or numbers that are not finite
   */
  hear({ inverse3 = [], wireless_verse_grip, verse_grip = [] }, at) {
    const [device] = inverse3;
    if (!device?.state) throw new TypeError("it has no Inverse3; is the device switched on?");
    const [grip] = wireless_verse_grip?.length ? wireless_verse_grip : verse_grip;
    const { buttons = {}, orientation } = grip?.state ?? {};
    const place = array(device.state.cursor_position);
    const attitude = orientation ? array(orientation) : [0, 0, 0, 1];
    this.heard = at;
    this.silent = false;
    this.device = device.device_id;
    this.render(device);
    if (![...place, ...attitude].every(Number.isFinite)) throw new RangeError("it has no place or attitude of the handle");
    const held = this.hand.grasp("haply", Object.values(buttons).some(Boolean));
    if (held && this.before) {
      const [[x, y, z], from] = this.before;
      const turn = turnAbout([0, 1, 0], from, attitude);
      if (Math.hypot(place[0] - x, place[1] - y, place[2] - z) > JUMP || Math.abs(turn) > TURN) {
        this.letGo();
        return this.page.said("the Haply's handle jumped: let go of its button and press it again");
      }
      this.hand.move([place[0] - x, z - place[2], place[1] - y, turn], at);
    }
    this.before = held ? [place, attitude] : null;
    this.page.changed();
  }

  /** Answer with the viscosity's force. @param {{state: any}} device */
  render({ state }) {
    const B = this.page.viscosity();
    const force = array(state.cursor_velocity).slice(0, 3).map((v) => -B * v || 0);
    const share = Math.min(1, STRONGEST / Math.hypot(...force)) || 0;
    this.answer(force.map((f) => share * f));
  }

  /** Ask for a force (3,) [N]; the service sends on only to who answers. @param {number[]} force */
  answer([x, y, z]) {
    this.answered += 1;
    this.socket?.send(JSON.stringify({ inverse3: [{ device_id: this.device, commands: { set_cursor_force: { values: { x, y, z } } } }] }));
  }

  /** Notice that nothing came. @param {number} now [ms] */
  tick(now) {
    if (!this.socket || this.silent || now - this.heard <= SILENCE) return;
    this.silent = true;
    this.letGo();
  }

  letGo() {
    this.before = null;
    this.hand.lose("haply");
    this.page.changed();
  }
}
