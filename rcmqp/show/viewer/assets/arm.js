// The arm as a chain of joints in Meshcat's tree: /run0/joint1/joint2/..., likewise for each run.

import { THREE } from "./meshcat.js";
import { ARM_LAYER, standard } from "./scenery.js";

/** @import { Mesh, Object3D, PerspectiveCamera, Quaternion, Vector3 } from "three" */
/** @typedef {import("./recording.js").ArmShape} ArmShape */
/** @typedef {import("./recording.js").Shown} Shown */
/** @typedef {import("./recording.js").Surroundings} Surroundings */

/**
 * A joint: where its link is at rest, on the link before, and its axis; one of the two is zero.
 * @typedef {{name: string, position: Vector3, quaternion: Quaternion, angular: Vector3, linear: Vector3}} Joint
 */

/**
 * The arm of each run, at one place until they are posed.
 *
 * @param {MeshcatViewer} viewer
 * @param {{arm: ArmShape, scene: Surroundings, runs: Shown[]}} data
 */
export function makeArms(viewer, { arm, scene, runs }) {
  for (const command of arm.commands) viewer.handle_command_bytearray(command);
  /** @param {string[]} path */
  const find = (path) => viewer.scene_tree.find(path).object;
  for (const part of arm.parts) dress(find(part.path), part.colour);
  const joints = arm.joints.map(({ name, placement, angular, linear }) => ({
    name,
    ...placed(placement),
    angular: new THREE.Vector3().fromArray(angular),
    linear: new THREE.Vector3().fromArray(linear),
  }));
  return runs.map((run, k) => {
    const links = /** @type {THREE.Object3D[]} */ ([]);
    let path = [`run${k}`];
    for (let i = 0; i < joints.length; i++) {
      path = [...path, `joint${i + 1}`];
      links.push(find(path));
    }
    if (k > 0) copyParts(find, arm.parts, k);
    const flange = find([...path.slice(0, arm.flange_joint + 1), "flange"]);
    const { position, quaternion } = placed(arm.flange);
    flange.position.copy(position);
    flange.quaternion.copy(quaternion);
    const { group, camera, wrist } = makeInstrument(scene.instrument);
    flange.add(group);
    wrist.forEach((part, i) => links[arm.flange_joint + i].add(part));
    return new Arm(find([`run${k}`]), joints, links, flange, camera, run.colour);
  });
}

/** A placement out of its matrix. @param {number[]} matrix column after column */
function placed(matrix) {
  const [position, quaternion] = [new THREE.Vector3(), new THREE.Quaternion()];
  new THREE.Matrix4().fromArray(matrix).decompose(position, quaternion, new THREE.Vector3());
  return { position, quaternion };
}

/**
 * Give a run the first run's shapes.
 *
 * @param {(path: string[]) => Object3D} find
 * @param {ArmShape["parts"]} parts
 * @param {number} k the run
 */
function copyParts(find, parts, k) {
  for (const part of parts) {
    const first = find(part.path);
    const copy = find([`run${k}`, ...part.path.slice(1)]);
    copy.position.copy(first.position);
    copy.quaternion.copy(first.quaternion);
    copy.scale.copy(first.scale);
    for (const child of first.children) copy.add(child.clone());
  }
}

/**
 * Meshcat's materials are flat: give each part one that takes the light well.
 *
 * @param {Object3D} object
 * @param {number[]} colour red, green and blue, 0 to 1
 */
function dress(object, colour) {
  const material = standard(new THREE.Color().fromArray(colour), { side: THREE.DoubleSide });
  object.traverse((mesh) => {
    if (!isMesh(mesh)) return;
    mesh.material = material;
    mesh.castShadow = mesh.receiveShadow = true;
  });
}

/** @param {Object3D} object @returns {object is Mesh} */
function isMesh(object) {
  return object instanceof THREE.Mesh;
}

/**
 * The shaft, the parts of the wrist, and the camera at the tip.
 *
 * @param {Surroundings["instrument"]} instrument
 */
function makeInstrument(instrument) {
  const { length, radius, mount_offset: offset, mount, field_of_view: field, angle, roll } = instrument;
  const group = new THREE.Group();
  const { position, quaternion } = placed(mount);
  group.position.copy(position);
  group.quaternion.copy(quaternion);
  /** @param {number} r @param {number} from @param {number} to @param {number} colour */
  const tube = (r, from, to, colour, part = group) => {
    const shape = new THREE.CylinderGeometry(r, r, to - from, 32);
    const mesh = new THREE.Mesh(shape, standard(colour, { shininess: 80, specular: 0x444444 }));
    mesh.rotation.x = Math.PI / 2;
    mesh.position.z = (from + to) / 2;
    mesh.castShadow = true;
    part.add(mesh);
  };
  const wrist = instrument.wrist.map((to) => {
    const part = new THREE.Group();
    if (to > 0) tube(0.8 * radius, 0, to, 0x202326, part);
    return part;
  });
  const tip = offset + length;
  const head = Math.min(0.05, 0.2 * length);
  if (offset > 0) tube(2.4 * radius, 0, offset, 0x3a3f45);
  tube(3.2 * radius, offset, offset + head, 0x3a3f45);
  tube(radius, offset + head, tip - 0.006, 0xa9b0b7);
  tube(1.02 * radius, tip - 0.006, tip, 0x202326);
  const camera = new THREE.PerspectiveCamera(THREE.MathUtils.radToDeg(field), 1, 0.0005, 5);
  camera.rotation.x = Math.PI - angle; // the image's y points down and z in; three.js looks along -z, y up
  camera.rotateZ(-roll);
  const [last, at] = wrist.length ? [wrist[wrist.length - 1], instrument.wrist[wrist.length - 1]] : [group, tip];
  camera.position.z = at;
  last.add(camera);
  return { group, camera, wrist };
}

/** An arm that can be posed, and shown in three ways. */
class Arm {
  /**
   * @param {Object3D} base
   * @param {Joint[]} joints
   * @param {Object3D[]} links one a joint
   * @param {Object3D} flange
   * @param {PerspectiveCamera} camera
   * @param {string} colour of its ghost, as CSS writes it
   */
  constructor(base, joints, links, flange, camera, colour) {
    this.base = base;
    this.joints = joints;
    this.links = links;
    this.flange = flange;
    this.camera = camera;
    /** @type {[Mesh, Mesh["material"]][]} */
    this.solid = [];
    base.traverse((object) => {
      if (isMesh(object)) this.solid.push([object, object.material]);
      object.layers.set(ARM_LAYER);
    });
    this.ghost = standard(colour, {
      transparent: true, opacity: 0.28, depthWrite: false,
      polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8, // behind what it coincides with
    });
  }

  /** Solid, a ghost in the run's colour, or not there. @param {"solid" | "ghost" | "hidden"} how */
  show(how) {
    this.base.visible = how !== "hidden";
    for (const [mesh, material] of this.solid) {
      mesh.material = how === "ghost" ? this.ghost : material;
      mesh.castShadow = how === "solid";
    }
  }

  /** How it was shown, by what is drawn. */
  get look() {
    const [[mesh]] = this.solid;
    return !this.base.visible ? "hidden" : mesh.material === this.ghost ? "ghost" : "solid";
  }

  /** @param {ArrayLike<number>} angles of the joints [rad], [m] where they slide */
  pose(angles) {
    const turn = new THREE.Quaternion();
    const slide = new THREE.Vector3();
    this.joints.forEach((joint, i) => {
      turn.setFromAxisAngle(joint.angular, angles[i] * joint.angular.length()); // 0 where it slides
      slide.copy(joint.linear).multiplyScalar(angles[i]).applyQuaternion(joint.quaternion);
      this.links[i].quaternion.copy(joint.quaternion).multiply(turn);
      this.links[i].position.copy(joint.position).add(slide);
    });
  }

  /**
   * World matrix of a joint's link, of the flange, or of the camera, column after column.
   *
   * @param {string} name of the joint, "flange" or "camera"
   */
  matrix(name) {
    const i = this.joints.findIndex((joint) => joint.name === name);
    const object = name === "flange" ? this.flange : name === "camera" ? this.camera : this.links[i];
    object.updateWorldMatrix(true, false);
    return object.matrixWorld.toArray();
  }
}
