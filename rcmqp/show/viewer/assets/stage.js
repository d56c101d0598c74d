// The 3-D scene in Meshcat's viewer, seen from outside, close up, and through the endoscope.

import { makeArms } from "./arm.js";
import { query } from "./elements.js";
import { millimetres } from "./format.js";
import { aim, outside } from "./framing.js";
import { TrailLine } from "./lines.js";
import { THREE, Viewer } from "./meshcat.js";
import {
  ARM_LAYER, INSIDE_LAYER, LEAST_ARROW, WALL,
  Arrow, addLight, atTrocar, css, groundShape, makeBall, makeGround, makeLimits, makeTrocar, makeWall, standard,
} from "./scenery.js";

/** @import { Mesh, Object3D, PerspectiveCamera, WebGLRenderer } from "three" */

/** What the scene is made of: its surroundings, the arm's shape, and runs with their sources. */
/** @typedef {{scene: import("./recording.js").Surroundings, arm: import("./recording.js").ArmShape, runs: import("./recording.js").Shown[]}} Data */

const VIEW_ANGLE = 26; // of the outside camera [deg]
const LIGHT_PIXELS = 0.6; // of a picture that is drawn without a graphics card, for one of the page
const OUTSIDE = ["wall", "trocar", "slip", "floor", "limits"]; // what the endoscope does not see

export class Stage {
  /**
   * @param {HTMLElement} pane of the scene, with #viewer, #lens and #slip in it
   * @param {HTMLElement} scopePane of the endoscope, with its canvas
   * @param {Data} data
   * @param {{antialias?: boolean}} how whether the endoscope's picture has smooth edges: software takes long for them
   */
  constructor(pane, scopePane, data, { antialias = true } = {}) {
    this.pane = pane;
    this.scopePane = scopePane;
    this.data = data;
    this.main = 0;
    this.ghosts = this.close = this.hasLens = this.dirty = false;
    this.magnify = 1;
    this.lensAt = [0, 0, 0]; // left, bottom and size [px]
    this.size = "";
    this.viewer = this.makeViewer(query(pane, "#viewer"));
    this.scope = this.makeScope(query(scopePane, "canvas"), antialias);
    this.arms = makeArms(this.viewer, data);
    /** @type {Record<string, Object3D[]>} */
    this.things = {};
    const home = new THREE.Vector3().fromArray(data.scene.pivot);
    addLight(this.viewer.scene_tree.find(["lights"]).object, home);
    this.moving = this.add("site", new THREE.Group()); // goes where the trocar goes
    this.furnish();
    const { runs } = data;
    this.desired = runs.map(({ source }) => // the main run's is shown: seed and controller may make others
      this.add("desired", new TrailLine(source.trail("tip_d"), css("desired"), 3.2 + 1.8 * runs.length)));
    this.trails = runs.map(({ source, colour }) =>
      this.add("trails", new TrailLine(source.trail("tip"), colour, 2.4)));
    this.arrows = runs.map(({ colour }) => this.add("slip", new Arrow(colour)));
    this.floor = this.add("floor", new THREE.Mesh(new THREE.PlaneGeometry(6, 6), new THREE.ShadowMaterial()));
    this.floor.position.set(home.x, home.y, Math.min(0, ...this.allPoints().map(([, , z]) => z)) - 0.03);
    this.floor.receiveShadow = true;
    // The operator sees the spheres only, not where they are best seen from.
    for (const name of data.scene.spheres.length ? [...OUTSIDE, "targets"] : OUTSIDE)
      for (const thing of this.things[name] ?? []) thing.traverse((each) => each.layers.set(ARM_LAYER));
    this.camera = new THREE.PerspectiveCamera(VIEW_ANGLE, 1, 0.02, 30);
    this.camera.up.set(0, 0, 1);
    this.camera.layers.enable(ARM_LAYER);
    this.lens = this.camera.clone();
    this.viewer.controls.dispose();
    this.viewer.set_camera(this.camera);
    new ResizeObserver(() => this.resize()).observe(pane);
    new ResizeObserver(() => this.resize()).observe(scopePane);
    this.time = this.draws = 0;
    /** Where the outside camera was asked to stand, of length 1. @type {number[] | null} */
    this.from = null;
    this.zoom = 1;
    this.ground = 1; // 0 lets through what is behind the scene
  }

  /** Draw coarser pictures, without shadows, or as fine as the screen is. @param {boolean} on */
  lighten(on) {
    this.viewer.renderer.shadowMap.enabled = !on;
    for (const renderer of [this.viewer.renderer, this.scope]) renderer.setPixelRatio(on ? LIGHT_PIXELS : window.devicePixelRatio);
    const ground = /** @type {Mesh} */ (this.things.ground[0]);
    ground.geometry.dispose();
    ground.geometry = groundShape({ coarse: on });
    this.size = ""; // fit again
    this.resize();
  }

  /** @param {HTMLElement} pane */
  makeViewer(pane) {
    const viewer = new Viewer(pane, false);
    viewer.set_3d_pane_size = () => this.resize();
    viewer.gui.domElement.remove();
    viewer.scene.rotation.set(0, 0, 0); // Meshcat lays the world on its side, y up; here z is up
    for (const name of ["Grid", "Axes", "Lights"]) viewer.delete_path([name]);
    viewer.set_property(["Background"], "visible", false);
    const canvas = viewer.renderer.domElement;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "the arm, its instrument in the trocar, and the trails of the tip");
    viewer.renderer.shadowMap.type = THREE.PCFShadowMap;
    prepare(viewer.renderer);
    return viewer;
  }

  /** @param {HTMLElement} canvas @param {boolean} antialias */
  makeScope(canvas, antialias) {
    const scope = new THREE.WebGLRenderer({ canvas, antialias, preserveDrawingBuffer: true });
    scope.setClearColor(0x2a0f0d, 1);
    prepare(scope);
    return scope;
  }

  /**
   * Put something into the scene, under a name that several may have.
   *
   * @template {Object3D} Thing
   * @param {string} name
   * @param {Thing} object
   * @param {Object3D} parent
   */
  add(name, object, parent = this.viewer.scene_tree.find(["scene"]).object) {
    this.things[name] = [...(this.things[name] ?? []), object];
    parent.add(object);
    return object;
  }

  /** What stands around the arm. */
  furnish() {
    const { scene } = this.data;
    const site = atTrocar(scene);
    this.moving.add(site);
    this.add("wall", makeWall(scene.instrument.radius), site);
    this.add("trocar", makeTrocar(scene.instrument.radius), site);
    this.add("limits", makeLimits(scene), site);
    this.add("ground", makeGround(scene), site);
    for (const centre of scene.targets)
      this.add("targets", makeBall(centre, 0.003, standard(css("target"), { emissive: 0x554d00 })), this.moving);
    for (const { centre, radius, colour } of scene.spheres)
      this.add("spheres", makeBall(centre, radius, standard(new THREE.Color().fromArray(colour))), this.moving);
    for (const { centre, radius } of scene.obstacles)
      this.add("obstacles", makeBall(centre, radius, standard(css("obstacle"), { transparent: true, opacity: 0.85 })));
  }

  /** What the outside camera is to see (3,) [m]: the whole arm, instrument, wall and trail. */
  allPoints() {
    const points = this.workPoints();
    const wall = atTrocar(this.data.scene);
    for (const [x, z] of [[1, 0], [0, 1], [-1, 0], [0, -1]])
      points.push(new THREE.Vector3(WALL * x, 0, WALL * z).applyQuaternion(wall.quaternion).add(wall.position).toArray());
    for (const [jx, jy, jz] of this.data.scene.skeleton.slice(0, -1))
      for (const [x, y, z] of [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
        for (const s of [-0.075, 0.075]) points.push([jx + s * x, jy + s * y, jz + s * z]);
    return points;
  }

  /** What the close-up is to see (3,) [m]: where tips and trocar go, and what is asked for. */
  workPoints() {
    const { scene, runs } = this.data;
    const points = runs.flatMap(({ source }) => source.visited());
    for (const { centre, radius } of [...scene.obstacles, ...scene.spheres])
      for (const s of [-radius, radius]) points.push(centre.map((x) => x + s));
    return [...points, ...scene.targets];
  }

  /** Put the outside camera where it sees all, or what is close to the trocar. */
  frame() {
    const { clientWidth: w, clientHeight: h } = this.pane;
    this.dirty = true;
    if (!w || !h) return;
    const { scene } = this.data;
    const points = this.close ? this.workPoints() : this.allPoints();
    const side = this.hasLens && !this.close ? this.lensAt[2] + 14 : 0; // left free for the lens
    const above = Math.min(h / 2, query(document, "#caption").offsetHeight); // and for what is written
    this.camera.aspect = w / h; // the lens reads it
    const direction = this.from ?? outside(scene.skeleton[0], scene.pivot, scene.axis);
    this.camera.zoom = this.zoom;
    const margin = this.close ? 1.3 : 1.06;
    const { position, target } = aim(points, direction, this.camera, margin, [(w - side) / w, (h - above) / h]);
    look(this.camera, position, target);
    this.camera.setViewOffset(w, h, side / 2, -above / 2, w, h);
    this.viewer.controls.target.fromArray(target);
    this.viewer.controls.update();
  }

  /** Fit both panes, if their size is another than before. */
  resize() {
    const { clientWidth: w, clientHeight: h } = this.pane;
    const scope = Math.min(this.scopePane.clientWidth, this.scopePane.clientHeight);
    if (String([w, h, scope]) === this.size) return;
    this.size = String([w, h, scope]);
    if (w && h) {
      this.viewer.renderer.setSize(w, h, false);
      const size = Math.round(Math.min(0.36 * w, 0.55 * h));
      this.hasLens = size >= 180;
      const lens = query(this.pane, "#lens").style;
      Object.assign(lens, { width: `${size}px`, height: `${size}px`, right: "10px", bottom: "10px" });
      this.lensAt = [w - size - 9, 11, size - 2]; // inside its border
    }
    if (scope) this.scope.setSize(scope, scope, false);
    this.frame();
  }

  /** Take the colours of the page, as they are now. */
  paint() {
    this.viewer.renderer.setClearColor(css("paper"), this.ground);
    for (const line of this.desired) line.uniforms.colour.value.set(css("desired"));
    this.floor.material.opacity = Number(css("shadow"));
    this.dirty = true;
  }

  /**
   * What is shown, and how; what is not given stays.
   *
   * @param {{main?: number, ghosts?: boolean, limits?: boolean, magnify?: number, close?: boolean}} changes
   */
  choose({ main = this.main, ghosts = this.ghosts, limits, magnify = this.magnify, close }) {
    Object.assign(this, { main, ghosts, magnify });
    if (limits !== undefined) this.things.limits[0].visible = limits;
    if (close !== undefined) {
      this.close = close;
      this.frame();
    }
    this.arms.forEach((arm, i) => arm.show(i === main ? "solid" : ghosts ? "ghost" : "hidden"));
    this.desired.forEach((line, i) => (line.visible = i === main));
    // The main run's trail is thin and in front, so that the others show beside it, each wider.
    this.trails.forEach((line, i) => {
      const rank = i === main ? 0 : i < main ? i + 1 : i;
      line.width = 1.8 * (rank + 1);
      line.uniforms.lift.value = 0.003 * (1 - rank / this.trails.length);
    });
    this.seek(this.time);
  }

  /**
   * Pose all as it is at a time, and draw the trails so far.
   *
   * @param {number} t [s]
   * @returns {import("./sources.js").State[]} of each run
   */
  seek(t) {
    this.time = t;
    this.dirty = true;
    return this.data.runs.map(({ source }, i) => {
      const state = source.at(t);
      this.arms[i].pose(state.angles);
      this.trails[i].cut(t);
      this.desired[i].follow();
      const pivot = new THREE.Vector3().fromArray(state.pivot);
      const slip = new THREE.Vector3().fromArray(state.slip);
      this.arrows[i].point(pivot, slip.clone().multiplyScalar(this.magnify));
      if (i === this.main) {
        this.label(slip.length());
        this.moving.position.copy(pivot).sub(new THREE.Vector3().fromArray(this.data.scene.pivot));
      }
      return state;
    });
  }

  /** Draw what has changed. */
  render() {
    if (!this.dirty && !this.viewer.needs_render) return;
    this.dirty = false;
    this.draws += 1;
    this.viewer.needs_render = false; // Meshcat forgets it only where it draws, and a pane may be hidden
    if (this.pane.clientWidth) this.renderScene();
    if (this.scopePane.clientWidth) this.scope.render(this.viewer.scene, this.inside());
  }

  renderScene() {
    this.viewer.render();
    const box = query(this.pane, "#lens");
    box.hidden = !(this.hasLens && !this.close) || this.coversLimits();
    if (!box.hidden) this.renderLens(this.viewer.renderer, this.lens, this.camera);
    const text = query(this.pane, "#slip");
    if (text.parentElement !== (box.hidden ? this.pane : box)) (box.hidden ? this.pane : box).append(text);
  }

  /** Whether the close-up would lie over the limits that are shown. */
  coversLimits() {
    const [limits] = this.things.limits;
    if (!limits.visible) return false;
    const { min, max } = new THREE.Box3().setFromObject(limits);
    const [left, bottom, size] = this.lensAt;
    const corners = [min, max].flatMap((a) => [min, max].flatMap((b) => [min, max].map((c) =>
      new THREE.Vector3(a.x, b.y, c.z).project(this.camera))));
    const right = Math.max(...corners.map(({ x }) => ((x + 1) / 2) * this.pane.clientWidth));
    const low = Math.min(...corners.map(({ y }) => ((y + 1) / 2) * this.pane.clientHeight));
    return right > left && low < bottom + size;
  }

  /**
   * The trocar and the trail, close, from where the outside camera looks.
   *
   * @param {WebGLRenderer} renderer
   * @param {PerspectiveCamera} lens
   * @param {PerspectiveCamera} camera
   */
  renderLens(renderer, lens, camera) {
    const away = camera.position.clone().sub(this.viewer.controls.target).normalize();
    lens.aspect = 1;
    const { position, target } = aim(this.workPoints(), away.toArray(), lens, 1.3);
    look(lens, position, target);
    lens.updateProjectionMatrix();
    const [x, y, size] = this.lensAt;
    renderer.setViewport(x, y, size, size);
    renderer.setScissor(x, y, size, size);
    renderer.setScissorTest(true);
    renderer.shadowMap.autoUpdate = false;
    renderer.render(this.viewer.scene, lens);
    renderer.shadowMap.autoUpdate = true;
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, this.pane.clientWidth, this.pane.clientHeight);
  }

  /** The main run's camera in the endoscope. */
  inside() {
    const { camera } = this.arms[this.main];
    camera.layers.set(0);
    camera.layers.enable(INSIDE_LAYER);
    return camera;
  }

  /**
   * Write how large the RCM error is, in a corner of the close-up, or of the pane without one.
   *
   * @param {number} size [m]
   */
  label(size) {
    const drawn = this.magnify * size > LEAST_ARROW ? `drawn \u00d7${this.magnify}` : "too small to draw";
    query(this.pane, "#slip").textContent = `RCM error ${millimetres(size)}${Number.isNaN(size) ? "" : `, ${drawn}`}`;
  }
}

/** @param {WebGLRenderer} renderer */
function prepare(renderer) {
  renderer.outputEncoding = THREE.sRGBEncoding;
  renderer.setPixelRatio(window.devicePixelRatio);
}

/** @param {PerspectiveCamera} camera @param {number[]} position [m] @param {number[]} target [m] */
function look(camera, position, target) {
  camera.position.fromArray(position);
  camera.lookAt(new THREE.Vector3().fromArray(target));
}
