// Numbers as the page writes them.

/**
 * A length in millimetres with three significant digits; below a picometre, where only rounding
 * is left, it is "<1e-9 mm".
 *
 * @param {number} x [m]; NaN is missing
 */
export function millimetres(x) {
  const mm = 1e3 * x;
  if (Number.isNaN(mm)) return "missing";
  if (mm < 1e-9) return "<1e-9 mm";
  return `${mm < 1e-3 ? mm.toExponential(2) : mm.toPrecision(3)} mm`;
}

/**
 * A depth in millimetres with one decimal.
 *
 * @param {number} x [m]; NaN is missing
 */
export function depth(x) {
  return Number.isNaN(x) ? "missing" : `${(1e3 * x).toFixed(1)} mm`;
}

/**
 * Decimals of the clock: short runs have more.
 *
 * @param {number | null} duration [s]; null while it is unknown
 */
export function decimals(duration) {
  return Math.max(2, Math.ceil(2 - Math.log10(duration || 1)));
}

/**
 * A time, and how long the run is where that is known.
 *
 * @param {number} time [s]
 * @param {number | null} duration [s]
 */
export function clockText(time, duration) {
  const places = decimals(duration);
  const now = time.toFixed(places);
  return duration === null ? `${now} s` : `${now} / ${duration.toFixed(places)} s`;
}
