// Controllers of a headset, by WebXR: one whose trigger or grip is held moves the hand.

import { SILENCE } from "./hands.js";
import { turnAbout } from "./vectors.js";

/** Where they are held. */
const SIDES = ["left", "right"];
/** The axis that a user looks along. */
const FORWARD = [0, 0, -1];

/** What WebXR gives, as far as it is used here. */
/** @typedef {{x: number, y: number, z: number, w: number}} Xyzw */
/** @typedef {{handedness: string, gripSpace?: object, gamepad?: {buttons: readonly {pressed: boolean}[]} | null}} Source */
/** @typedef {{getPose(space: object, base: object): {transform: {position: Xyzw, orientation: Xyzw}, emulatedPosition?: boolean} | null | undefined}} Frame */

export class Controllers {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {() => void} changed is called after each reading
   */
  constructor(hand, changed) {
    this.hand = hand;
    this.changed = changed;
    /** Where each was while it was held, and its attitude. @type {Map<string, [number[], number[]]>} */
    this.before = new Map();
    /** When they were read [ms]. */
    this.heard = -Infinity;
  }

  /**
   * Follow the controllers: x to the right, y up, z towards the user, as the headset was at the start.
   *
   * @param {Source[]} sources
   * @param {(space: object) => ReturnType<Frame["getPose"]>} pose of a space; without one, or where its position is a guess, it is not tracked
   * @param {number} at [ms]
   */
  read(sources, pose, at) {
    this.heard = at;
    for (const side of SIDES) {
      const source = sources.find(({ handedness }) => handedness === side);
      const found = source?.gripSpace && pose(source.gripSpace);
      const pressed = source?.gamepad?.buttons.slice(0, 2).some((button) => button.pressed) ?? false;
      if (!found || found.emulatedPosition) {
        this.lose(side);
        continue;
      }
      if (!this.hand.grasp(`${side} controller`, pressed)) {
        this.before.delete(side);
        continue;
      }
      const [{ x, y, z }, q] = [found.transform.position, found.transform.orientation];
      const now = /** @type {[number[], number[]]} */ ([[x, y, z], [q.x, q.y, q.z, q.w]]);
      const [[a, b, c], from] = this.before.get(side) ?? now;
      this.hand.move([x - a, b - y, c - z, turnAbout(FORWARD, from, now[1])], at);
      this.before.set(side, now);
    }
    this.changed();
  }

  /** Notice that no picture was asked for, so that nobody reads the controllers. @param {number} now [ms] */
  tick(now) {
    if (!this.before.size || now - this.heard <= SILENCE) return;
    SIDES.forEach((side) => this.lose(side));
    this.changed();
  }

  /** @param {string} side */
  lose(side) {
    this.before.delete(side);
    this.hand.lose(`${side} controller`);
  }
}
