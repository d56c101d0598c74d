// What hands do at the page, as the way of one handle: x to the right, y down, z into the patient
// [m], and roll clockwise [rad], in the axes of the picture.

/** How far the hand goes for a drag across the whole picture [m]. */
const SPAN = 0.08;
/** For a pinch to twice the distance [m]. */
const PINCH = 0.03;
/** For a notch of the wheel, 100 of its units [m]. */
const NOTCH = 0.004;
/** Of a held key, or a stick that is pushed to its end [m/s], [rad/s]. */
const SPEED = [0.03, 0.03, 0.02, 0.6];
/** A stick nearer to its middle does nothing. */
export const IDLE = 0.12;

/** Keys by what they do: axis of the way, and direction. @type {Record<string, [number, number]>} */
export const KEYS = {
  ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 1], ArrowUp: [1, -1],
  KeyW: [2, 1], KeyS: [2, -1], KeyE: [3, 1], KeyQ: [3, -1],
};

/** A device that has said nothing for so long while it should is let go [ms]. */
export const SILENCE = 100;

/** The dead-man of a gamepad: its right shoulder. */
const SHOULDER = 5;

export class Hand {
  constructor() {
    this.way = [0, 0, 0, 0];
    this.grip = 0; // how often somebody has taken hold
    /** When the input happened that has not been sent yet [ms]; null for none. @type {number | null} */
    this.event = null;
    /** Pointers that are down: where [px], and what each is. @type {Map<number, [number, number, string]>} */
    this.pointers = new Map();
    /** Other things that are held: keys, a gamepad. @type {Set<string>} */
    this.others = new Set();
    /** Devices whose dead-man was seen let go since the last release. @type {Set<string>} */
    this.free = new Set();
    /** The number of the gamepad that was read last. */
    this.pad = -1;
  }

  /** Whether the dead-man is held. */
  get held() { return this.pointers.size + this.others.size > 0; }

  /** Whether the operator feels the viscosity at the handle: other hands beside it do not. */
  get felt() { return this.others.has("haply") && this.pointers.size + this.others.size === 1; }

  /** What holds: mouse, touch, pen, keys, gamepad, headset, space mouse, haply. */
  get devices() {
    const others = [...this.others].map((name) => (name in KEYS ? "keys" : name.endsWith(" controller") ? "headset" : name));
    return [...new Set([...this.pointers.values()].map(([, , kind]) => kind).concat(others))];
  }

  /** Something is about to be held: the first takes a new grip. */
  take() {
    if (!this.held) this.grip += 1;
  }

  /** Let go of all; what is still down has to be let go and pressed anew. */
  release() {
    this.pointers.clear();
    this.others.clear();
    this.free.clear();
  }

  /** @param {number[]} step (4,) @param {number} at when [ms] */
  move(step, at) {
    step.forEach((value, i) => (this.way[i] += value));
    this.event ??= at;
  }

  /** @param {number} id @param {[number, number]} place [px] @param {string} kind mouse, touch or pen */
  down(id, place, kind) {
    this.take();
    this.pointers.set(id, [...place, kind]);
  }

  /** @param {number} id */
  up(id) { this.pointers.delete(id); }

  /**
   * A pointer that is down has moved. Two of them pinch and twist.
   *
   * @param {number} id
   * @param {[number, number]} place [px]
   * @param {{size: number, shift: boolean, at: number}} how size of the picture [px]; whether Shift
   *   makes of a drag depth and roll; when [ms]
   */
  drag(id, place, { size, shift, at }) {
    const before = this.pointers.get(id);
    if (!before) return;
    const [x, y] = [place[0] - before[0], place[1] - before[1]];
    if (!x && !y) return; // the browser has told of it before
    const other = [...this.pointers].find(([each]) => each !== id)?.[1];
    this.pointers.set(id, [...place, before[2]]);
    const scale = SPAN / size;
    if (other) {
      const [from, to] = [before, place].map((p) => [p[0] - other[0], p[1] - other[1]]);
      const [near, far] = [from, to].map(([u, v]) => Math.max(1, Math.hypot(u, v)));
      const turn = Math.atan2(from[0] * to[1] - from[1] * to[0], from[0] * to[0] + from[1] * to[1]);
      this.move([(scale * x) / 2, (scale * y) / 2, PINCH * Math.log2(far / near), turn], at);
    } else if (shift) this.move([0, 0, -scale * y, (2 * Math.PI * x) / (2 * size)], at);
    else this.move([scale * x, scale * y, 0, 0], at);
  }

  /** The wheel counts while something is held. @param {number} notches @param {number} at [ms] */
  wheel(notches, at) {
    if (this.held) this.move([0, 0, -NOTCH * notches, 0], at);
  }

  /** @param {string} code of a key that goes down @returns {boolean} whether it is one of ours */
  press(code) {
    if (!(code in KEYS)) return false;
    this.take();
    this.others.add(code);
    return true;
  }

  /** @param {string} code */
  lift(code) { this.others.delete(code); }

  /**
   * A device's dead-man is pressed, or let go. After release() it has to be let go first.
   *
   * @param {string} device
   * @param {boolean} pressed
   * @returns {boolean} whether the device holds
   */
  grasp(device, pressed) {
    if (!pressed) {
      this.free.add(device);
      this.others.delete(device);
    } else if (this.free.has(device)) {
      this.take();
      this.others.add(device);
    }
    return this.others.has(device);
  }

  /** A device is not heard or seen any more: its dead-man has to be let go and pressed anew. @param {string} device */
  lose(device) {
    this.others.delete(device);
    this.free.delete(device);
  }

  /**
   * Sticks, or a cap, that are pushed from their middle while their device holds.
   *
   * @param {number[]} pushed (4,) each from -1 to 1, in the axes of the way
   * @param {number} passed since the last time [s]
   * @param {number} at [ms]
   */
  push(pushed, passed, at) {
    const rates = pushed.map((value, i) => (Math.abs(value) < IDLE ? 0 : value * SPEED[i]));
    if (rates.some(Boolean)) this.move(rates.map((rate) => rate * passed), at);
  }

  /**
   * Read a gamepad: its shoulder holds, the left stick moves, the right one goes in and rolls. One
   * that is plugged in anew, or is another one, has to be let go first.
   *
   * @param {{index: number, axes: readonly number[], buttons: readonly {pressed: boolean}[]} | null} pad
   * @param {number} passed since the last time [s]
   * @param {number} at [ms]
   */
  read(pad, passed, at) {
    if (pad?.index !== this.pad) this.lose("gamepad");
    this.pad = pad?.index ?? -1;
    if (!pad) return;
    if (!this.grasp("gamepad", pad.buttons[SHOULDER]?.pressed ?? false)) return;
    const [x = 0, y = 0, roll = 0, out = 0] = pad.axes;
    this.push([x, y, -out, roll], passed, at);
  }

  /** What held keys do meanwhile. @param {number} passed since the last time [s] @param {number} at [ms] */
  tick(passed, at) {
    const step = [0, 0, 0, 0];
    for (const code of this.others)
      if (code in KEYS) step[KEYS[code][0]] += KEYS[code][1] * SPEED[KEYS[code][0]] * passed;
    if (step.some(Boolean)) this.move(step, at);
  }
}
