// The arm as a chain of joints in Meshcat's tree: /run0/joint1/joint2/..., likewise for each run.

function makeArms(viewer, data) {
  const THREE = MeshCat.THREE;
  for (const command of data.arm.commands) viewer.handle_command_bytearray(command);
  const find = (path) => viewer.scene_tree.find(path).object;
  for (const part of data.arm.parts) dress(find(part.path), part.colour);
  const joints = data.arm.joints.map((joint) => {
    const rest = { position: new THREE.Vector3(), quaternion: new THREE.Quaternion() };
    new THREE.Matrix4().fromArray(joint.placement)
      .decompose(rest.position, rest.quaternion, new THREE.Vector3());
    return {
      name: joint.name,
      rest,
      angular: new THREE.Vector3(...joint.angular),
      linear: new THREE.Vector3(...joint.linear),
    };
  });
  return data.runs.map((run, k) => {
    const base = find([`run${k}`]);
    const links = [];
    let path = [`run${k}`];
    for (let i = 0; i < joints.length; i++) {
      path = [...path, `joint${i + 1}`];
      links.push(find(path));
    }
    if (k > 0) copyParts(viewer, data.arm.parts, k);
    const flange = find([...path, "flange"]);
    new THREE.Matrix4().fromArray(data.arm.flange)
      .decompose(flange.position, flange.quaternion, flange.scale);
    const instrument = makeInstrument(data.scene.instrument);
    flange.add(instrument.group);
    return new Arm(run, base, joints, links, flange, instrument);
  });
}

function copyParts(viewer, parts, k) {
  for (const part of parts) {
    const first = viewer.scene_tree.find(part.path).object;
    const copy = viewer.scene_tree.find([`run${k}`, ...part.path.slice(1)]).object;
    copy.position.copy(first.position);
    copy.quaternion.copy(first.quaternion);
    copy.scale.copy(first.scale);
    for (const child of first.children) copy.add(child.clone());
  }
}

// Meshcat's materials are flat: give each part one that takes the light well.
function dress(object, colour) {
  const material = standard(new MeshCat.THREE.Color(...colour), { side: MeshCat.THREE.DoubleSide });
  object.traverse((mesh) => {
    if (!mesh.isMesh) return;
    mesh.material = material;
    mesh.castShadow = mesh.receiveShadow = true;
  });
}

function makeInstrument({ length, radius, mount_offset: offset, field_of_view: angle }) {
  const THREE = MeshCat.THREE;
  const group = new THREE.Group();
  const tube = (r, from, to, colour) => {
    const shape = new THREE.CylinderGeometry(r, r, to - from, 32);
    const mesh = new THREE.Mesh(shape, standard(colour, { shininess: 80, specular: 0x444444 }));
    mesh.rotation.x = Math.PI / 2;
    mesh.position.z = (from + to) / 2;
    mesh.castShadow = true;
    group.add(mesh);
  };
  const tip = offset + length;
  const head = Math.min(0.05, 0.2 * length);
  if (offset > 0) tube(2.4 * radius, 0, offset, 0x3a3f45);
  tube(3.2 * radius, offset, offset + head, 0x3a3f45);
  tube(radius, offset + head, tip - 0.006, 0xa9b0b7);
  tube(1.02 * radius, tip - 0.006, tip, 0x202326);
  const camera = new THREE.PerspectiveCamera(THREE.MathUtils.radToDeg(angle), 1, 0.0005, 5);
  camera.rotation.x = Math.PI; // the image's y points down and z in; three.js looks along -z, y up
  camera.position.z = tip;
  group.add(camera);
  return { group, camera };
}

class Arm {
  constructor(run, base, joints, links, flange, instrument) {
    Object.assign(this, { run, base, joints, links, flange, camera: instrument.camera });
    this.solid = [];
    base.traverse((mesh) => {
      if (mesh.isMesh) this.solid.push([mesh, mesh.material]);
      mesh.layers.set(ARM_LAYER);
    });
    this.ghost = standard(run.colour, {
      transparent: true, opacity: 0.28, depthWrite: false,
      polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8, // behind what it coincides with
    });
  }

  // Solid, a ghost in the run's colour, or not there.
  show(how) {
    this.base.visible = how !== "hidden";
    for (const [mesh, material] of this.solid) {
      mesh.material = how === "ghost" ? this.ghost : material;
      mesh.castShadow = how === "solid";
    }
  }

  // How it was shown, by what is drawn.
  get look() {
    const [[mesh]] = this.solid;
    return !this.base.visible ? "hidden" : mesh.material === this.ghost ? "ghost" : "solid";
  }

  pose(t) {
    const angles = sample(this.run, "angles", t);
    const turn = new MeshCat.THREE.Quaternion();
    const slide = new MeshCat.THREE.Vector3();
    this.joints.forEach((joint, i) => {
      turn.setFromAxisAngle(joint.angular, angles[i] * joint.angular.length()); // 0 where it slides
      slide.copy(joint.linear).multiplyScalar(angles[i]).applyQuaternion(joint.rest.quaternion);
      this.links[i].quaternion.copy(joint.rest.quaternion).multiply(turn);
      this.links[i].position.copy(joint.rest.position).add(slide);
    });
  }

  // World matrix of a joint's link, of the flange, or of the camera, column after column.
  matrix(name) {
    const i = this.joints.findIndex((joint) => joint.name === name);
    const object = { flange: this.flange, camera: this.camera }[name] ?? this.links[i];
    object.updateWorldMatrix(true, false);
    return object.matrixWorld.toArray();
  }
}
