// The page's elements.

/**
 * An element that the page has.
 *
 * @param {ParentNode} where
 * @param {string} selector
 * @returns {HTMLElement}
 * @throws {Error} there is none
 */
export function query(where, selector) {
  const found = where.querySelector(selector);
  if (!(found instanceof HTMLElement)) throw new Error(`the page has no ${selector}`);
  return found;
}

/** @param {string} id of an input or a list to choose from */
export function input(id) {
  return /** @type {HTMLInputElement | HTMLSelectElement} */ (query(document, `#${id}`));
}

/**
 * A swatch of a kind and style, and what it stands for.
 *
 * @param {string} kind class of the swatch
 * @param {string} text
 * @param {Partial<CSSStyleDeclaration>} style
 */
export function mark(kind, text, style = {}) {
  const [all, swatch] = [document.createElement("span"), document.createElement("i")];
  swatch.className = kind;
  Object.assign(swatch.style, style);
  all.className = "mark";
  all.append(swatch, text);
  return all;
}
