// When the server is told of the hand: soon after each input, and not more often than it listens.

/** How often a held hand is told of [ms]. */
export const EVERY = 16;
/** Least time from one message to the next [ms]: the server takes 300 in a second. */
export const LEAST = 4;

/** @typedef {{now: () => number, later: (then: () => void, delay: number) => void}} Clock in [ms] */

/** @type {Clock} */
const CLOCK = { now: () => performance.now(), later: (then, delay) => setTimeout(then, delay) };

export class Teller {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {{steers: () => boolean, send: () => void}} page whether it steers; send() tells the server of the hand
   * @param {Clock} clock
   */
  constructor(hand, page, clock = CLOCK) {
    this.hand = hand;
    this.page = page;
    this.clock = clock;
    /** When the last message was sent [ms], and whether it said that the hand is held. */
    this.told = 0;
    this.sent = false;
    this.waits = false;
  }

  /** Tell the server of the hand now, and that it has let go without fail. */
  tell() {
    const held = this.hand.held;
    if (!this.page.steers() || (!held && !this.sent)) return;
    this.told = this.clock.now();
    this.sent = held;
    this.page.send();
  }

  /** After an input: at once, or as soon as the last message is old enough. */
  changed() {
    const rest = this.told + LEAST - this.clock.now();
    if (rest <= 0 || !this.hand.held) this.tell();
    else if (!this.waits) {
      this.waits = true;
      this.clock.later(() => {
        this.waits = false;
        if (this.hand.event !== null) this.changed(); // another message may have gone meanwhile
      }, Math.ceil(rest)); // a browser cuts fractions off
    }
  }

  /** Tell of a held hand from time to time. */
  tick() {
    if (this.clock.now() - this.told >= EVERY - 1) this.tell();
  }
}
