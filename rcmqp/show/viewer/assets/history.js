// Rows of numbers by name, in the order of time, that grow at the end.

/** @typedef {Float32Array | Float64Array} Floats */

/**
 * Where a time falls in an array that rises: the row before, and how far it is to the next, 0 to 1;
 * at the last row, or alone, it is 0.
 *
 * @param {Floats} times at least one
 * @param {number} t
 * @returns {[number, number]}
 */
export function place(times, t) {
  let low = 0;
  let high = times.length - 1;
  if (t <= times[0]) return [0, 0];
  if (t >= times[high]) return [high, 0];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return [low, (t - times[low]) / (times[high] - times[low])];
}

/**
 * Rows in a fixed amount of memory. When it is full, the older half of the rows is dropped, so
 * that each column stays in one piece and in order.
 *
 * @template {string} Name
 */
export class History {
  /**
   * @param {Record<Name, number>} widths how many numbers a row has, by name of the column
   * @param {number} rows how many are kept at most, 2 or more
   */
  constructor(widths, rows) {
    if (!(Number.isInteger(rows) && rows >= 2)) throw new RangeError(`rows = ${rows}, it must be a whole number, 2 or more`);
    this.widths = widths;
    this.rows = rows;
    this.count = 0; // rows that are kept
    this.dropped = 0; // rows that were there before
    this.names = /** @type {Name[]} */ (Object.keys(widths));
    /** @type {Record<string, Float64Array>} */
    this.columns = {};
    for (const name of this.names) this.columns[name] = new Float64Array(rows * widths[name]);
  }

  /**
   * Add a row at the end.
   *
   * @param {Record<Name, ArrayLike<number>>} row
   */
  push(row) {
    for (const name of this.names) {
      const [given, width] = [row[name]?.length, this.widths[name]];
      if (given !== width) throw new RangeError(`${name} has ${given ?? "no"} numbers, it must have ${width}`);
    }
    if (this.count === this.rows) this.dropHalf();
    for (const name of this.names) this.columns[name].set(row[name], this.count * this.widths[name]);
    this.count += 1;
  }

  dropHalf() {
    const gone = Math.ceil(this.rows / 2);
    for (const name of this.names) this.columns[name].copyWithin(0, gone * this.widths[name]);
    this.count -= gone;
    this.dropped += gone;
  }

  /** Forget all rows. */
  clear() {
    this.dropped += this.count;
    this.count = 0;
  }

  /**
   * All rows of a column, one after the other; a view that the next push() may change.
   *
   * @param {Name} name
   */
  column(name) {
    return this.columns[name].subarray(0, this.count * this.widths[name]);
  }
}
