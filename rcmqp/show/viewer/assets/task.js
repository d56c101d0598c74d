// A task or a practice of a trial, on the page of the console: its pictures, its clock, its buttons.

import { query } from "./elements.js";
import { THREE } from "./meshcat.js";
import { ARM_LAYER } from "./scenery.js";

/** @import { PerspectiveCamera } from "three" */

/** Pixels of a picture, across. */
const ACROSS = 240;

/**
 * @typedef {object} Orders
 * @property {string} title
 * @property {string} instructions
 * @property {number} seconds of a practice [s]; 0 for a task
 * @property {string} note what happened before, if it has to be said
 * @property {number[][]} views from the camera at the start to each place, see page.py
 */

/**
 * Each sphere as a camera shows it: its middle, right and down, and its radius, over half the picture.
 *
 * @param {import("./stage.js").Stage} stage
 * @param {PerspectiveCamera} camera
 */
export function sight({ things, moving, data }, camera) {
  camera.updateWorldMatrix(true, false);
  moving.updateWorldMatrix(true, true);
  const half = Math.tan((camera.fov * Math.PI) / 360);
  return (things.spheres ?? []).map((ball, i) => {
    const at = new THREE.Vector3().setFromMatrixPosition(ball.matrixWorld);
    const away = at.clone().applyMatrix4(camera.matrixWorld.clone().invert()).length();
    const { x, y } = at.project(camera);
    return [x, -y, data.scene.spheres[i].radius / (half * away)];
  });
}

/** @param {number} seconds */
function minutesText(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

export class Task {
  /**
   * @param {Orders} orders
   * @param {import("./stage.js").Stage} stage
   * @param {import("./link.js").Link} link
   */
  constructor(orders, stage, link) {
    this.orders = orders;
    this.stage = stage;
    this.started = false;
    /** Where the camera is to be. @type {PerspectiveCamera[]} */
    this.cameras = [];
    document.body.dataset.task = orders.seconds ? "practice" : "task";
    query(document, "#task").hidden = false;
    query(document, "#orders").textContent = [orders.note, orders.instructions].filter(Boolean).join(" ");
    const start = query(document, "#start");
    start.addEventListener("pointerdown", (event) => event.stopPropagation()); // the picture would take it as a grip
    start.addEventListener("click", () => {
      this.started = true;
      link.send({ kind: "start" });
    });
    query(document, "#break").addEventListener("click", () => {
      if (window.confirm("Break off here? You can go on later.")) link.send({ kind: "break" });
    });
    for (const name of ["trails", "desired"]) // the camera's way is no part of what it sees
      for (const thing of stage.things[name]) thing.traverse((each) => each.layers.set(ARM_LAYER));
  }

  /** Draw the pictures that are to be found; the arm is at its start. */
  draw() {
    const inside = this.stage.inside();
    inside.updateWorldMatrix(true, false);
    this.cameras = this.orders.views.map((view) => {
      const camera = inside.clone(false);
      const placed = new THREE.Matrix4().fromArray(view).multiply(inside.matrixWorld);
      placed.decompose(camera.position, camera.quaternion, camera.scale);
      return camera;
    });
    const scope = this.stage.scope;
    query(document, "#views").replaceChildren(...this.cameras.map((camera, i) => {
      const [figure, canvas, caption] = [document.createElement("figure"), document.createElement("canvas"), document.createElement("figcaption")];
      Object.assign(canvas, { width: ACROSS, height: ACROSS });
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `picture ${i + 1} that is to be found`);
      scope.render(this.stage.viewer.scene, camera);
      canvas.getContext("2d")?.drawImage(scope.domElement, 0, 0, ACROSS, ACROSS);
      caption.textContent = String(i + 1);
      figure.append(canvas, caption);
      return figure;
    }));
    this.stage.dirty = true;
  }

  /** @param {boolean} steers @param {import("./link.js").Live | null} newest */
  write(steers, newest) {
    const { seconds, views } = this.orders;
    const found = newest?.reached.length ?? 0;
    query(document, "#start").hidden = !steers || this.started || newest !== null;
    query(document, "#break").hidden = !steers;
    query(document, "#watch").textContent = minutesText(seconds ? Math.ceil(seconds - (newest?.time ?? 0)) : newest?.time ?? 0);
    query(document, "#goal").textContent = seconds ? "practice, time left" : `${found} of ${views.length} pictures found`;
    if (!seconds) [...query(document, "#views").children].forEach((figure, i) =>
      figure.setAttribute("class", i < found ? "found" : i === found ? "now" : ""));
  }
}
