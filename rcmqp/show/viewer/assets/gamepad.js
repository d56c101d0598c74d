// A gamepad, which the browser has to be asked for.

/** Ticks between two looks for a gamepad while there is none. */
export const TICKS_BETWEEN_LOOKS = 8;

/** @typedef {{index: number, axes: readonly number[], buttons: readonly {pressed: boolean}[]}} Pad */

export class Gamepad {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {() => readonly (Pad | null)[]} all those that are plugged in; takes up to half a millisecond
   */
  constructor(hand, all = () => navigator.getGamepads()) {
    this.hand = hand;
    this.all = all;
    this.rest = 0;
  }

  /** Read the first one. @param {number} passed since the last time [s] @param {number} now [ms] */
  tick(passed, now) {
    if (this.rest > 0) {
      this.rest -= 1;
      return;
    }
    const pad = this.all().find(Boolean) ?? null;
    this.hand.read(pad, passed, now);
    this.rest = pad ? 0 : TICKS_BETWEEN_LOOKS;
  }
}
