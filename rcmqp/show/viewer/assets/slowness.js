// When the page says that the loop is slow, and by how much.

/** The share of skipped cycles above which the loop is said to be slow, and below which no more. */
const [BEGINS, ENDS] = [0.05, 0.02];
/** Percentages are rounded to a multiple of this one, and are at least that. */
const ROUNDED = 5;
/** Without a state for so long, nothing is said [ms]. */
export const NO_STATE = 1000;

export class Slowness {
  constructor() {
    /** Whether the loop is said to be slow, and by how much about [%]. */
    this.on = false;
    this.percent = ROUNDED;
  }

  /**
   * @param {number} skipped share of the last cycles, as the newest state says
   * @param {number} age of that state [ms]
   */
  see(skipped, age) {
    this.on = age < NO_STATE && skipped > (this.on ? ENDS : BEGINS);
    if (this.on) this.percent = ROUNDED * Math.max(1, Math.round((100 * skipped) / ROUNDED));
  }
}
