// The page's one clock: it plays a recording, or follows what is live.

/** Speeds that can be chosen; 1 is as fast as the run was. */
export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];

/** A picture that takes longer is no slow one: the page was out of sight [s]. */
const PAUSE = 2;

export class Clock {
  /** @param {import("./sources.js").FrameSource[]} sources one or more, of one scenario */
  constructor(sources) {
    this.sources = sources;
    this.time = 0; // [s]
    this.playing = false;
    this.speed = 1;
  }

  /** Length of the longest source [s]; null while one of them is unknown. */
  get duration() {
    const all = this.sources.map(({ duration }) => duration);
    return all.reduce((a, b) => (a === null || b === null ? null : Math.max(a, b)));
  }

  /** The latest time that there is something to see at [s]. */
  get end() {
    return Math.max(0, ...this.sources.map(({ newest }) => newest).filter(Number.isFinite));
  }

  /** @param {number} t [s]; a time before the beginning or after the end becomes the nearest one */
  seek(t) {
    this.time = Math.max(0, Math.min(this.end, t));
  }

  /** Start; at the end of a recording, from its beginning. */
  play() {
    if (this.duration !== null && this.time >= this.end) this.seek(0);
    this.playing = true;
  }

  pause() {
    this.playing = false;
  }

  /**
   * Go on, if it plays: by what has passed times the speed, to a recording's end; to the newest
   * frame of what is live.
   *
   * @param {number} passed since the last time [s]
   */
  tick(passed) {
    if (!this.playing) return;
    const isLive = this.duration === null;
    this.seek(isLive ? this.end : this.time + this.speed * Math.min(PAUSE, passed));
    if (!isLive && this.time >= this.end) this.pause();
  }
}
