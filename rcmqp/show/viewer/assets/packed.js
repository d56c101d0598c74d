// Libraries and numbers that the page carries in compressed form. All of them begin to unpack at
// once, side by side, when the page opens.

/** @type {Map<string, Promise<ArrayBuffer>>} */
const packed = new Map();
for (const element of document.querySelectorAll('script[type="text/plain"]'))
  packed.set(element.id, inflate(element));

/** @param {string} text */
function fromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text); // in browsers before 2025
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

/** @param {Element} element */
function inflate(element) {
  const bytes = fromBase64(element.textContent ?? "");
  element.remove();
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

/**
 * The bytes of a part of the page, which can be taken once.
 *
 * @param {string} id of its element
 * @returns {Promise<ArrayBuffer>}
 */
export function unpacked(id) {
  const bytes = packed.get(id);
  if (!bytes) throw new Error(`the page has no part ${id}`);
  packed.delete(id); // its memory is free once it is used
  return bytes;
}

/**
 * Run a library that the page carries, as a script of its own.
 *
 * @param {string} id of its element
 */
export async function runLibrary(id) {
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await unpacked(id));
  document.head.append(script);
}
