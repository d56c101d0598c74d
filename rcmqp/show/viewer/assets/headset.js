// A headset, by WebXR: the endoscope's picture hangs in front of the user, and a controller whose
// trigger or grip is held moves the hand.

import { THREE } from "./meshcat.js";
import { turnAbout } from "./vectors.js";

/** How far away the picture hangs, and its size [m]. */
const [AWAY, SIZE] = [1.2, 1.1];
/** The axis that a user looks along. */
const FORWARD = [0, 0, -1];

/** What WebXR gives, as far as it is used here. */
/** @typedef {{x: number, y: number, z: number, w: number}} Xyzw */
/** @typedef {{handedness: string, gripSpace?: object, gamepad?: {buttons: readonly {pressed: boolean}[]} | null}} Source */
/** @typedef {{getPose(space: object, base: object): {transform: {position: Xyzw, orientation: Xyzw}} | null | undefined}} Frame */
/** @typedef {EventTarget & {inputSources: Iterable<Source>, visibilityState: string, end(): Promise<void>}} Session */
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
    this.hand = hand;
    this.page = page;
    /** Where each controller was while it was held, and its attitude. @type {Map<string, [number[], number[]]>} */
    this.before = new Map();
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
      if (frame && base) this.read([...session.inputSources], (space) => frame.getPose(space, base), performance.now());
      const draws = this.page.draw(now);
      if (draws !== drawn) texture.needsUpdate = true;
      drawn = draws;
      renderer.render(scene, camera);
    });
    await renderer.xr.setSession(/** @type {any} */ (session));
  }

  release() {
    this.before.clear();
    this.page.released();
  }

  /**
   * Follow the controllers: x to the right, y up, z towards the user, as the headset was at the start.
   *
   * @param {Source[]} sources
   * @param {(space: object) => ReturnType<Frame["getPose"]>} pose of a space; without one it is not tracked
   * @param {number} at [ms]
   */
  read(sources, pose, at) {
    for (const side of ["left", "right"]) {
      const source = sources.find(({ handedness }) => handedness === side);
      const found = source?.gripSpace && pose(source.gripSpace);
      const pressed = source?.gamepad?.buttons.slice(0, 2).some((button) => button.pressed) ?? false;
      const held = this.hand.grasp(`${side} controller`, Boolean(found) && pressed);
      if (!held || !found) {
        this.before.delete(side);
        continue;
      }
      const [{ x, y, z }, q] = [found.transform.position, found.transform.orientation];
      const now = /** @type {[number[], number[]]} */ ([[x, y, z], [q.x, q.y, q.z, q.w]]);
      const [[a, b, c], from] = this.before.get(side) ?? now;
      this.hand.move([x - a, b - y, c - z, turnAbout(FORWARD, from, now[1])], at);
      this.before.set(side, now);
    }
    this.page.changed();
  }
}
