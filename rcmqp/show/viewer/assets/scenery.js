// What stands around the arm: trocar, wall, limits, targets, obstacles, arrow, light.

import { THREE } from "./meshcat.js";

/** @import { Vector3, Material, MeshPhongMaterialParameters, ColorRepresentation, Object3D } from "three" */
/** @typedef {import("./recording.js").Surroundings} Surroundings */

export const ARM_LAYER = 1; // seen from outside only: the endoscope would look at its own inside
export const INSIDE_LAYER = 2; // seen through the endoscope only
export const WALL = 0.1; // radius of the patch of abdominal wall [m]

/** What page.css says of a name: a colour, or how dark shadows are. @param {string} name */
export function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/**
 * A material that takes the light.
 *
 * @param {ColorRepresentation} colour as CSS writes it
 * @param {MeshPhongMaterialParameters} extra
 */
export function standard(colour, extra = {}) {
  const material = new THREE.MeshPhongMaterial({ shininess: 30, specular: 0x1c1c1c, ...extra });
  material.color.set(colour).convertSRGBToLinear();
  return material;
}

/**
 * A group at the trocar whose y axis points out of the patient, as three.js turns its lathes.
 *
 * @param {Surroundings} scene
 */
export function atTrocar(scene) {
  const group = new THREE.Group();
  const out = new THREE.Vector3().fromArray(scene.axis).negate();
  group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), out);
  group.position.fromArray(scene.pivot);
  return group;
}

/** A patch of the abdominal wall. @param {number} radius of the shaft [m] */
export function makeWall(radius) {
  const hole = 2.6 * radius, rim = WALL, thick = 0.012, bend = 0.28;
  /** @param {number} r */
  const height = (r) => -(r * r) / (2 * bend);
  const profile = [];
  const radii = Array.from({ length: 11 }, (_, i) => hole + (rim - hole) * (i / 10));
  for (const r of radii) profile.push(new THREE.Vector2(r, height(r) + thick / 2));
  for (const r of radii.reverse()) profile.push(new THREE.Vector2(r, height(r) - thick / 2));
  profile.push(profile[0]);
  const skin = standard(0xe3a78c, { transparent: true, opacity: 0.55, side: THREE.DoubleSide, depthWrite: false });
  const wall = new THREE.Mesh(new THREE.LatheGeometry(profile, 96), skin);
  wall.receiveShadow = true;
  wall.renderOrder = 2;
  return wall;
}

/** @param {number} radius of the shaft [m] */
export function makeTrocar(radius) {
  const ring = new THREE.Mesh(
    new THREE.TorusGeometry(2.1 * radius, 0.62 * radius, 20, 64), standard(0x26292d));
  ring.rotation.x = Math.PI / 2;
  ring.castShadow = true;
  ring.renderOrder = 3;
  return ring;
}

/**
 * The shaft may lie in the cone and the tip between the two caps, which are parts of spheres.
 *
 * @param {Surroundings} scene
 */
export function makeLimits(scene) {
  const [low, high] = scene.depth_range;
  const angle = Math.min(scene.cone_half_angle, Math.PI);
  const group = new THREE.Group();
  /** @param {string} colour */
  const skin = (colour) => standard(colour, {
    transparent: true, opacity: 0.3, side: THREE.DoubleSide, depthWrite: false,
  });
  const cone = [];
  for (const r of [Math.max(low, 0), high]) {
    cone.push(new THREE.Vector2(r * Math.sin(angle), -r * Math.cos(angle)));
    if (r <= 0) continue;
    const cap = new THREE.SphereGeometry(r, 72, 24, 0, 2 * Math.PI, Math.PI - angle, angle);
    group.add(new THREE.Mesh(cap, skin(css("depths"))));
  }
  group.add(new THREE.Mesh(new THREE.LatheGeometry(cone, 96), skin(css("cone"))));
  for (const mesh of group.children) mesh.renderOrder = 4;
  group.visible = false;
  return group;
}

/** @param {number[]} centre [m] @param {number} radius [m] @param {Material} material */
export function makeBall(centre, radius, material) {
  const ball = new THREE.Mesh(new THREE.SphereGeometry(radius, 40, 24), material);
  ball.position.fromArray(centre);
  ball.castShadow = ball.receiveShadow = true;
  return ball;
}

/** Parts of the ground, across; and where software draws it. */
const [FINE, COARSE] = [140, 64];

/**
 * The shape and colours of the ground: a bowl, with folds.
 *
 * @param {{coarse: boolean}} how fine
 */
export function groundShape({ coarse }) {
  const parts = coarse ? COARSE : FINE;
  const geometry = new THREE.PlaneGeometry(0.8, 0.8, parts, parts);
  const at = geometry.attributes.position;
  const tones = new Float32Array(3 * at.count);
  const [pale, deep] = [new THREE.Color(0xc9796a), new THREE.Color(0x8f3a34)].map((c) => c.convertSRGBToLinear());
  const tone = new THREE.Color();
  for (let i = 0; i < at.count; i++) {
    const x = at.getX(i), y = at.getY(i);
    const folds = Math.sin(70 * x + 2 * Math.sin(55 * y)) + Math.sin(62 * y + 1.7 * Math.sin(48 * x + 1));
    at.setZ(i, 0.0035 * folds + 0.6 * (x * x + y * y));
    tone.copy(pale).lerp(deep, 0.5 - 0.25 * folds).toArray(tones, 3 * i);
  }
  geometry.setAttribute("color", new THREE.BufferAttribute(tones, 3));
  geometry.computeVertexNormals();
  return geometry;
}

/**
 * Soft ground beyond the deepest tip, seen through the endoscope only, to show that it moves.
 *
 * @param {Surroundings} scene
 */
export function makeGround(scene) {
  const skin = standard(0xffffff, { vertexColors: true, side: THREE.DoubleSide, shininess: 60 });
  const ground = new THREE.Mesh(groundShape({ coarse: false }), skin);
  ground.rotation.x = -Math.PI / 2;
  ground.position.y = -(scene.deepest + 0.06);
  ground.layers.set(INSIDE_LAYER);
  return ground;
}

export const LEAST_ARROW = 5e-4; // a shorter one is less than a pixel of the close-up [m]

/** An arrow that is thin where it is short, and not drawn where it would be less than a pixel. */
export class Arrow extends THREE.Group {
  /** @param {string} colour as CSS writes it */
  constructor(colour) {
    super();
    const material = new THREE.MeshBasicMaterial({ depthTest: false, transparent: true });
    material.color.set(colour).convertSRGBToLinear();
    this.stem = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 16), material);
    this.head = new THREE.Mesh(new THREE.ConeGeometry(1, 1, 24), material);
    this.add(this.stem, this.head);
    for (const mesh of this.children) mesh.renderOrder = 6;
  }

  /** @param {Vector3} from [m] @param {Vector3} vector to its tip [m] */
  point(from, vector) {
    const length = vector.length();
    this.visible = length > LEAST_ARROW;
    if (!this.visible) return;
    const tip = Math.min(0.007, 0.5 * length);
    this.position.copy(from);
    this.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), vector.clone().divideScalar(length));
    const thick = Math.min(0.0009, 0.12 * tip); // a third of the head
    this.stem.scale.set(thick, length - tip, thick);
    this.stem.position.y = (length - tip) / 2;
    this.head.scale.set(0.36 * tip, tip, 0.36 * tip);
    this.head.position.y = length - tip / 2;
  }
}

/** @param {Object3D} root @param {Vector3} centre what is lit [m] */
export function addLight(root, centre) {
  const key = new THREE.DirectionalLight(0xffffff, 0.74);
  key.position.copy(centre).add(new THREE.Vector3(0.9, -1.6, 2.6));
  key.target.position.copy(centre);
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  key.shadow.camera.left = key.shadow.camera.bottom = -0.9;
  key.shadow.camera.right = key.shadow.camera.top = 0.9;
  key.shadow.camera.near = 0.5;
  key.shadow.camera.far = 6;
  key.shadow.bias = -0.0006;
  key.shadow.normalBias = 0.002;
  key.shadow.radius = 4;
  const fill = new THREE.DirectionalLight(0xe8f0ff, 0.2);
  fill.position.copy(centre).add(new THREE.Vector3(-2, -1.2, 0.8));
  const back = new THREE.DirectionalLight(0xffffff, 0.22);
  back.position.copy(centre).add(new THREE.Vector3(0.6, 2.2, 1.4));
  fill.target = back.target = key.target;
  root.add(key, key.target, fill, back, new THREE.HemisphereLight(0xffffff, 0x9a948c, 0.38));
  for (const light of root.children) if (light instanceof THREE.Light) light.layers.enableAll();
}
