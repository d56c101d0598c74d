// Where the page takes a run's motion from: a recording, or an arm that moves now.

import { History, place } from "./history.js";
import { Trail } from "./trail.js";

/**
 * What is known at one time. A missing number is NaN.
 *
 * @typedef {object} State
 * @property {ArrayLike<number>} angles of the joints [rad], [m] where they slide
 * @property {ArrayLike<number>} tip (3,) in the world [m]
 * @property {ArrayLike<number>} tip_d (3,) desired tip in the world [m]
 * @property {ArrayLike<number>} pivot (3,) the trocar in the world [m]
 * @property {ArrayLike<number>} slip (3,) from the trocar to the nearest point of the shaft's axis [m]
 * @property {ArrayLike<number>} tip_error (1,) [m]
 * @property {ArrayLike<number>} depth (1,) of the tip [m]
 */

/** @typedef {import("./history.js").Floats} Floats */
/** @typedef {{time: Floats} & {[name in keyof State]: Floats}} Frames */

/**
 * The interface that scene, clock and legend see of a run.
 *
 * @typedef {object} FrameSource
 * @property {number | null} duration [s]; null while it is unknown
 * @property {number} newest time of the newest frame [s]; NaN before there is one
 * @property {(t: number) => State} at the state at a time [s], straight between two frames; before
 *   the oldest frame it is that one, after the newest that one
 * @property {(name: "tip" | "tip_d") => Trail} trail the way of a point so far; it may grow
 * @property {() => number[][]} visited some of the tips and trocars (3,) so far, for the cameras [m]
 */

/** @type {Record<Exclude<keyof State, "angles">, number>} */
const WIDTHS = { tip: 3, tip_d: 3, pivot: 3, slip: 3, tip_error: 1, depth: 1 };

/**
 * The state at a time. Missing numbers do not reach into frames that have them.
 *
 * @param {Frames} frames at least one
 * @param {number} t [s]
 * @returns {State}
 */
function stateAt({ time, ...columns }, t) {
  const [row, share] = place(time, t);
  const sampled = Object.entries(columns).map(([name, array]) => {
    const width = array.length / time.length;
    const at = row * width;
    const values = Array.from({ length: width }, (_, i) =>
      share === 0 ? array[at + i] : array[at + i] + share * (array[at + width + i] - array[at + i]));
    return [name, values];
  });
  return Object.fromEntries(sampled);
}

/**
 * Tips and trocars of about a hundred frames, but for missing ones.
 *
 * @param {Frames} frames
 */
function visited({ time, tip, pivot }) {
  const points = [];
  const step = Math.max(1, Math.floor(time.length / 100));
  for (let i = 0; i < time.length; i += step)
    for (const column of [tip, pivot]) points.push([...column.subarray(3 * i, 3 * i + 3)]);
  return points.filter((point) => !point.some(Number.isNaN));
}

/**
 * A run that is over: all its frames are known.
 *
 * @implements {FrameSource}
 */
export class RecordedSource {
  /** @param {Frames} frames at least one */
  constructor(frames) {
    this.frames = frames;
    this.duration = this.newest = frames.time[frames.time.length - 1];
  }

  /** @param {number} t */
  at(t) { return stateAt(this.frames, t); }

  /** @param {"tip" | "tip_d"} name */
  trail(name) {
    const { time, [name]: points } = this.frames;
    const trail = new Trail(Math.max(2, time.length));
    time.forEach((t, i) => trail.push(t, points.subarray(3 * i, 3 * i + 3)));
    return trail;
  }

  visited() { return visited(this.frames); }
}

/** Frames that a live source keeps at most: ten seconds at 60 Hz, five at least. */
const FRAMES = 600;
/** Points that a live trail keeps at most. */
const POINTS = 4000;
/** How far a tip has moved when its live trail goes on [m]. */
const STEP = 2e-4;

/**
 * An arm that moves now: frames are pushed one by one as they come. Memory is bounded: of frames
 * and trails, the older half is dropped when they are full.
 *
 * @implements {FrameSource}
 */
export class LiveSource {
  /** @param {number} joints how many the arm has */
  constructor(joints, { frames = FRAMES, points = POINTS, step = STEP } = {}) {
    /** @type {number | null} */
    this.duration = null;
    /** @type {History<"time" | keyof State>} */
    this.history = new History({ time: 1, angles: joints, ...WIDTHS }, frames);
    this.trails = { tip: new Trail(points, step), tip_d: new Trail(points, step) };
  }

  get newest() {
    const times = this.history.column("time");
    return times.length ? times[times.length - 1] : NaN;
  }

  /**
   * Take a frame.
   *
   * @param {number} time [s]
   * @param {State} state
   * @returns {boolean} false for a frame that is not newer than the newest one: it is left out
   * @throws {RangeError} the time is not finite, or a part of the state has too many or too few numbers
   */
  push(time, state) {
    if (!Number.isFinite(time)) throw new RangeError(`time = ${time} s, it must be finite`);
    if (time <= this.newest) return false;
    this.history.push({ ...state, time: [time] });
    this.trails.tip.push(time, state.tip);
    this.trails.tip_d.push(time, state.tip_d);
    return true;
  }

  /** Forget all frames and trails, for an arm whose clock starts again. */
  clear() {
    this.history.clear();
    this.trails.tip.clear();
    this.trails.tip_d.clear();
  }

  /** @param {number} t at least one frame was pushed */
  at(t) { return stateAt(this.frames, t); }

  /** @param {"tip" | "tip_d"} name */
  trail(name) { return this.trails[name]; }

  visited() { return visited(this.frames); }

  /** @returns {Frames} */
  get frames() {
    const columns = this.history.names.map((name) => [name, this.history.column(name)]);
    return Object.fromEntries(columns);
  }
}
