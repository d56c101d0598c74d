// The way of a point, without the stretches where it stands still.

import { History, place } from "./history.js";

/** How far a point has moved when its trail goes on [m]. */
const STILL = 2e-5;

export class Trail {
  /**
   * @param {number} rows how many points are kept at most
   * @param {number} still a point that moved less is not added [m]
   */
  constructor(rows, still = STILL) {
    this.still = still;
    this.history = new History({ time: 1, point: 3 }, rows);
  }

  /** How many points are kept, and how many older ones were dropped. */
  get count() { return this.history.count; }
  get dropped() { return this.history.dropped; }

  /** The points (x, y, z, x, y, z, ...) in the world [m], the oldest first. */
  get points() { return this.history.column("point"); }

  /**
   * Go on to a point; one that is missing (NaN) or near the last one is left out.
   *
   * @param {number} time [s]
   * @param {ArrayLike<number>} point (3,) [m]
   */
  push(time, point) {
    const { points } = this;
    const n = points.length;
    const moved = Math.hypot(point[0] - points[n - 3], point[1] - points[n - 2], point[2] - points[n - 1]);
    if (n > 0 && !(moved > this.still)) return;
    if (Number.isNaN(point[0] + point[1] + point[2])) return;
    this.history.push({ time: [time], point });
  }

  /** Forget all points. */
  clear() { this.history.clear(); }

  /**
   * How many stretches, the oldest first, are drawn at a time: to the point that is gone to then.
   *
   * @param {number} t [s]
   */
  stretches(t) {
    if (this.count === 0) return 0;
    const [row, share] = place(this.history.column("time"), t);
    return row + (share > 0 ? 1 : 0);
  }
}
