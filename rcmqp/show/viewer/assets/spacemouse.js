// A space mouse, by WebHID: while one of its buttons is held, its cap moves the hand.

import { IDLE, SILENCE } from "./hands.js";

/** Who makes them: 3Dconnexion, and Logitech before. */
const MAKERS = [{ vendorId: 0x256f }, { vendorId: 0x046d, usagePage: 1, usage: 8 }];
/** What the cap says at its end. */
const FULL = 350;
/** Numbers of its reports: ways, turns and buttons; newer ones have the turns beside the ways. */
const [WAYS, TURNS, BUTTONS] = [1, 2, 3];

/** @typedef {{reportId: number, data: DataView}} Report */

/** What WebHID gives, as far as it is used here. */
/** @typedef {EventTarget & {opened: boolean, open(): Promise<void>}} Device */
/** @typedef {EventTarget & {getDevices(): Promise<Device[]>, requestDevice(options: object): Promise<Device[]>}} Hid */

export class SpaceMouse {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {() => void} changed is called after each report
   */
  constructor(hand, changed) {
    this.hand = hand;
    this.changed = changed;
    this.ways = [0, 0, 0]; // right, towards the user, down: as the cap says
    this.turns = [0, 0, 0]; // about them
    this.pressed = false;
    /** When the cap has said where it is [ms]. */
    this.heard = -Infinity;
  }

  /** Go on with one that was allowed before. @param {Hid} hid */
  async resume(hid) {
    hid.addEventListener("disconnect", () => this.gone());
    for (const device of await hid.getDevices()) await this.listen(device);
  }

  /** Let the user choose one. @param {Hid} hid */
  async connect(hid) {
    for (const device of await hid.requestDevice({ filters: MAKERS })) await this.listen(device);
  }

  /** @param {Device} device */
  async listen(device) {
    if (device.opened) return;
    await device.open();
    device.addEventListener("inputreport", (event) => this.hear(/** @type {Event & Report} */ (event), performance.now()));
  }

  /** @param {Report} report @param {number} at [ms] */
  hear({ reportId, data }, at) {
    /** @param {number} from */
    const three = (from) => [0, 2, 4].map((i) => data.getInt16(from + i, true) / FULL);
    if (reportId === WAYS && data.byteLength >= 6) this.ways = three(0);
    if (reportId === WAYS && data.byteLength >= 12) this.turns = three(6);
    if (reportId === TURNS && data.byteLength >= 6) this.turns = three(0);
    if (reportId === WAYS || reportId === TURNS) this.heard = at;
    if (reportId !== BUTTONS) return;
    this.pressed = new Uint8Array(data.buffer, data.byteOffset, data.byteLength).some(Boolean);
    this.hand.grasp("space mouse", this.pressed);
    this.changed();
  }

  /** It was unplugged. */
  gone() {
    this.ways = this.turns = [0, 0, 0];
    this.pressed = false;
    this.hand.grasp("space mouse", false);
    this.changed();
  }

  /** What the cap does meanwhile. @param {number} passed since the last time [s] @param {number} at [ms] */
  tick(passed, at) {
    if (!this.hand.grasp("space mouse", this.pressed)) return;
    const [[right, back, down], [, about]] = [this.ways, this.turns];
    const pushed = [right, down, -back, -about].map((x) => Math.max(-1, Math.min(1, x)));
    if (at - this.heard > SILENCE && pushed.some((x) => Math.abs(x) >= IDLE)) return this.lost();
    this.hand.push(pushed, passed, at);
  }

  /** Its cap was pushed, and then nothing came: it may be out of reach. A cap at rest sends nothing either. */
  lost() {
    this.ways = this.turns = [0, 0, 0];
    this.hand.lose("space mouse");
    this.changed();
  }
}
