// A headset, by WebXR: the endoscope's picture hangs in front of the user, whose controllers move the hand.

import { Controllers } from "./controllers.js";
import { THREE } from "./meshcat.js";

/** How far away the picture hangs, and its size [m]. */
const [AWAY, SIZE] = [1.2, 1.1];

/** What WebXR gives, as far as it is used here. */
/** @typedef {EventTarget & {inputSources: Iterable<import("./controllers.js").Source>, visibilityState: string, end(): Promise<void>}} Session */
/** @typedef {{isSessionSupported(mode: string): Promise<boolean>, requestSession(mode: string): Promise<Session>}} Xr */

/**
 * @typedef {object} Seen
 * @property {() => void} changed is called after each input
 * @property {() => void} released is called when the picture is not seen any more
 * @property {(now: number) => number} draw makes the picture, and says how many were made
 * @property {HTMLCanvasElement} picture
 */

export class Headset {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {Seen} page
   */
  constructor(hand, page) {
    this.page = page;
    this.controllers = new Controllers(hand, page.changed);
    /** @type {Session | null} */
    this.session = null;
  }

  /** Show the picture, or end that. @param {Xr} xr */
  async toggle(xr) {
    if (this.session) return void (await this.session.end());
    const session = (this.session = await xr.requestSession("immersive-vr"));
    const renderer = new THREE.WebGLRenderer({ antialias: false });
    renderer.xr.enabled = true;
    renderer.xr.setReferenceSpaceType("local");
    const texture = new THREE.CanvasTexture(this.page.picture);
    texture.encoding = renderer.outputEncoding = THREE.sRGBEncoding;
    const picture = new THREE.Mesh(new THREE.PlaneGeometry(SIZE, SIZE), new THREE.MeshBasicMaterial({ map: texture }));
    picture.position.z = -AWAY;
    const [scene, camera] = [new THREE.Scene(), new THREE.PerspectiveCamera()];
    scene.add(picture);
    let drawn = -1;
    session.addEventListener("visibilitychange", () => {
      if (session.visibilityState !== "visible") this.release();
    });
    session.addEventListener("end", () => {
      this.session = null;
      renderer.setAnimationLoop(null);
      renderer.dispose();
      this.release();
    });
    renderer.setAnimationLoop((/** @type {number} */ now, /** @type {any} */ frame) => {
      const base = renderer.xr.getReferenceSpace();
      if (frame && base) this.controllers.read([...session.inputSources], (space) => frame.getPose(space, base), performance.now());
      const draws = this.page.draw(now);
      if (draws !== drawn) texture.needsUpdate = true;
      drawn = draws;
      renderer.render(scene, camera);
    });
    await renderer.xr.setSession(/** @type {any} */ (session));
  }

  release() {
    this.controllers.before.clear();
    this.page.released();
  }
}
