// Whether pictures are drawn by software, without a graphics card.

/** What software that draws calls itself. */
const NAMES = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** @param {string} renderer as WEBGL_debug_renderer_info names it */
export const isSoftware = (renderer) => NAMES.test(renderer);

/** Ask a temporary WebGL context. */
export function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const known = gl?.getExtension("WEBGL_debug_renderer_info");
  const found = known ? isSoftware(String(gl?.getParameter(known.UNMASKED_RENDERER_WEBGL))) : false;
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return found;
}
