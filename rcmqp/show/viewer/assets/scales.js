// Ranges of the plots' axes, and how much the RCM error is magnified.

/** Ratio of the runs' maxima above which an error is drawn logarithmically. */
const FAR_APART = 30;

/** Factors that the RCM error is magnified by: a helix at 1 kHz slips by tenths of a micrometre. */
export const MAGNIFY = [1, 10, 100, 1000, 10000];

/** How long a magnified RCM error may be [mm]. */
const LONGEST = 30;

/**
 * The largest value, not counting missing ones; 0 without any.
 *
 * @param {Float32Array} values
 */
export function largest(values) {
  return values.reduce((a, b) => (b > a ? b : a), 0); // false for NaN
}

/**
 * What a hundredth of the values, not counting missing ones, lies below.
 *
 * @param {Float32Array} values
 */
export function hundredth(values) {
  const sorted = values.filter((value) => !Number.isNaN(value)).sort();
  return sorted[Math.floor(0.01 * sorted.length)];
}

/**
 * Range of a logarithmic axis, in powers of ten, for curves whose maxima lie so far apart that the
 * small ones would be a line at zero; null for others. It starts below all but the lowest
 * hundredth of each curve, but no more than three decades below the least maximum.
 *
 * @param {Float32Array[]} curves
 * @returns {[number, number] | null}
 */
export function logarithmic(curves) {
  const most = curves.map(largest);
  const [least, greatest] = [Math.min(...most), Math.max(...most)];
  if (!(least > 0 && greatest > FAR_APART * least)) return null;
  const low = Math.min(...curves.map(hundredth));
  return [Math.log10(Math.max(0.5 * low, 1e-3 * least)), Math.log10(greatest) + 0.3];
}

/**
 * The largest magnification that draws RCM errors within 3 cm; 1 if none does.
 *
 * @param {Float32Array[]} curves RCM errors [mm]
 */
export function fitting(curves) {
  const most = Math.max(...curves.map(largest));
  return MAGNIFY.findLast((factor) => factor * most <= LONGEST) ?? 1;
}

/**
 * The value that is some steps up or down a list; its ends are not passed.
 *
 * @param {number[]} list
 * @param {number} value of the list
 * @param {number} by steps
 */
export function step(list, value, by) {
  return list[Math.max(0, Math.min(list.length - 1, list.indexOf(value) + by))];
}
