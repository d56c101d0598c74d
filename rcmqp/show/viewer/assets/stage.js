// The 3-D scene in Meshcat's viewer, seen from outside, close up, and through the endoscope.

const VIEW_ANGLE = 26; // of the outside camera [deg]

class Stage {
  constructor(pane, scopePane, data) {
    const THREE = MeshCat.THREE;
    Object.assign(this, { pane, scopePane, data, main: 0, ghosts: false, magnify: 1, close: false });
    const viewer = (this.viewer = new MeshCat.Viewer(pane.querySelector("#viewer"), false));
    viewer.set_3d_pane_size = () => this.resize();
    viewer.gui.domElement.remove();
    viewer.scene.rotation.set(0, 0, 0); // Meshcat lays the world on its side, y up; here z is up
    for (const name of ["Grid", "Axes", "Lights"]) viewer.delete_path([name]);
    viewer.set_property(["Background"], "visible", false);
    const canvas = scopePane.querySelector("canvas");
    const about = { role: "img", "aria-label": "the arm, its instrument in the trocar, and the trails of the tip" };
    for (const name in about) viewer.renderer.domElement.setAttribute(name, about[name]);
    this.scope = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.scope.setClearColor(0x2a0f0d, 1);
    viewer.renderer.shadowMap.type = THREE.PCFShadowMap;
    for (const renderer of [viewer.renderer, this.scope]) {
      renderer.outputEncoding = THREE.sRGBEncoding;
      renderer.setPixelRatio(window.devicePixelRatio);
    }
    this.arms = makeArms(viewer, data);
    this.things = {};
    this.furnish();
    this.camera = new THREE.PerspectiveCamera(VIEW_ANGLE, 1, 0.02, 30);
    this.camera.up.set(0, 0, 1);
    this.camera.layers.enable(ARM_LAYER);
    this.lens = this.camera.clone();
    viewer.controls.dispose();
    viewer.set_camera(this.camera);
    new ResizeObserver(() => this.resize()).observe(pane);
    new ResizeObserver(() => this.resize()).observe(scopePane);
    this.time = this.draws = 0;
  }

  add(name, object, parent) {
    this.things[name] = [...(this.things[name] ?? []), object];
    (parent ?? this.viewer.scene_tree.find(["scene"]).object).add(object);
    return object;
  }

  furnish() {
    const THREE = MeshCat.THREE;
    const { scene, runs } = this.data;
    const home = new THREE.Vector3(...scene.pivot);
    addLight(this.viewer.scene_tree.find(["lights"]).object, home);
    this.moving = this.add("site", new THREE.Group()); // goes where the trocar goes
    const site = atTrocar(scene);
    this.moving.add(site);
    this.add("wall", makeWall(scene.instrument.radius), site);
    this.add("trocar", makeTrocar(scene.instrument.radius), site);
    this.add("limits", makeLimits(scene), site);
    this.add("ground", makeGround(scene), site);
    for (const centre of scene.targets)
      this.add("targets", makeBall(centre, 0.003, standard(css("target"), { emissive: 0x554d00 })), this.moving);
    for (const { centre, radius, colour } of scene.spheres)
      this.add("spheres", makeBall(centre, radius, standard(new THREE.Color(...colour))), this.moving);
    for (const { centre, radius } of scene.obstacles)
      this.add("obstacles", makeBall(centre, radius, standard(css("obstacle"), { transparent: true, opacity: 0.85 })));
    this.desired = runs.map((run) => // the main run's is shown: seed and controller may make others
      this.add("desired", thickLine(trail(run, "tip_d").points, css("desired"), 3.2 + 1.8 * runs.length)));
    this.trails = runs.map((run, i) => {
      const { points, times } = trail(run, "tip");
      const line = this.add("trails", thickLine(points, run.colour, 2.4));
      return { line, times };
    });
    this.arrows = runs.map((run) => this.add("slip", makeArrow(run.colour)));
    const points = this.allPoints();
    const low = Math.min(0, ...points.map((p) => p.z)) - 0.03;
    this.floor = this.add("floor", new THREE.Mesh(new THREE.PlaneGeometry(6, 6), new THREE.ShadowMaterial()));
    this.floor.position.set(home.x, home.y, low);
    this.floor.receiveShadow = true;
    const outside = ["wall", "trocar", "slip", "floor", "limits"];
    if (scene.spheres.length) outside.push("targets"); // the operator sees the spheres only
    for (const name of outside)
      for (const thing of this.things[name]) thing.traverse((each) => each.layers.set(ARM_LAYER));
  }

  // What the outside camera is to see: the whole arm, instrument, wall and trail.
  allPoints() {
    const THREE = MeshCat.THREE;
    const points = this.workPoints();
    const wall = atTrocar(this.data.scene);
    for (const [x, z] of [[1, 0], [0, 1], [-1, 0], [0, -1]])
      points.push(new THREE.Vector3(WALL * x, 0, WALL * z).applyQuaternion(wall.quaternion).add(wall.position));
    for (const joint of this.data.scene.skeleton.slice(0, -1))
      for (const [x, y, z] of [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
        for (const s of [-0.075, 0.075])
          points.push(new THREE.Vector3(joint[0] + s * x, joint[1] + s * y, joint[2] + s * z));
    return points;
  }

  workPoints() {
    const THREE = MeshCat.THREE;
    const { scene, runs } = this.data;
    const points = [];
    for (const run of runs) {
      const { tip, pivot } = run.frames;
      const step = 3 * Math.max(1, Math.floor(tip.length / 300));
      for (let i = 0; i + 2 < tip.length; i += step)
        points.push(new THREE.Vector3(tip[i], tip[i + 1], tip[i + 2]), new THREE.Vector3(pivot[i], pivot[i + 1], pivot[i + 2]));
    }
    for (const { centre, radius } of [...scene.obstacles, ...scene.spheres])
      for (const s of [-radius, radius]) points.push(new THREE.Vector3(centre[0] + s, centre[1] + s, centre[2] + s));
    for (const centre of scene.targets) points.push(new THREE.Vector3(...centre));
    return points;
  }

  // Somewhat from above, from where base and trocar lie well apart, the base to the left if it can
  // be, and the wall is seen from its edge, so that it does not hide the trail.
  direction() {
    const THREE = MeshCat.THREE;
    const { scene } = this.data;
    const axis = new THREE.Vector3(...scene.axis);
    const ahead = new THREE.Vector3(...scene.pivot).sub(new THREE.Vector3(...scene.skeleton[0])).setZ(0);
    if (ahead.length() < 1e-3) ahead.set(1, 0, 0);
    ahead.normalize();
    let best = null;
    for (let degrees = 0; degrees < 360; degrees += 5) {
      const turn = THREE.MathUtils.degToRad(degrees);
      const towards = new THREE.Vector3(Math.cos(turn), Math.sin(turn), 0.33).normalize();
      const right = new THREE.Vector3().crossVectors(new THREE.Vector3(0, 0, 1), towards).normalize();
      const inFront = 0.3 * towards.dot(ahead);
      const score = right.dot(ahead) + inFront - 3 * Math.max(0, Math.abs(towards.dot(axis)) - 0.25);
      if (!best || score > best.score) best = { score, towards };
    }
    return best.towards;
  }

  // Put a camera where it just sees all points in a share of its image, and return what it looks at.
  aim(camera, points, direction, margin, share = [1, 1]) {
    const THREE = MeshCat.THREE;
    const x = new THREE.Vector3().crossVectors(new THREE.Vector3(0, 0, 1), direction).normalize();
    const y = new THREE.Vector3().crossVectors(direction, x);
    const span = (axis) => {
      const along = points.map((p) => p.dot(axis));
      return [Math.min(...along), Math.max(...along)];
    };
    const centre = new THREE.Vector3();
    for (const axis of [x, y, direction]) {
      const [low, high] = span(axis);
      centre.addScaledVector(axis, (low + high) / 2);
    }
    const half = Math.tan(THREE.MathUtils.degToRad(camera.fov / 2));
    const [wide, tall] = [half * camera.aspect * share[0], half * share[1]];
    let distance = 0.05;
    for (const p of points) {
      const seen = p.clone().sub(centre);
      const reach = Math.max(Math.abs(seen.dot(x)) / wide, Math.abs(seen.dot(y)) / tall);
      distance = Math.max(distance, margin * reach + seen.dot(direction));
    }
    camera.position.copy(centre).addScaledVector(direction, distance);
    camera.lookAt(centre);
    return centre;
  }

  frame() {
    const { clientWidth: w, clientHeight: h } = this.pane;
    this.dirty = true;
    if (!w || !h) return;
    const points = this.close ? this.workPoints() : this.allPoints();
    const side = this.hasLens && !this.close ? this.lensAt[2] + 14 : 0; // left free for the lens
    const above = Math.min(h / 2, document.getElementById("caption").offsetHeight); // and for what is written
    const share = [(w - side) / w, (h - above) / h];
    this.camera.aspect = w / h; // aim() reads it
    const target = this.aim(this.camera, points, this.direction(), this.close ? 1.3 : 1.06, share);
    this.camera.setViewOffset(w, h, side / 2, -above / 2, w, h);
    this.viewer.controls.target.copy(target);
    this.viewer.controls.update();
  }

  // Fit both panes, if their size is another than before.
  resize() {
    const { clientWidth: w, clientHeight: h } = this.pane;
    const scope = Math.min(this.scopePane.clientWidth, this.scopePane.clientHeight);
    if (String([w, h, scope]) === this.size) return;
    this.size = String([w, h, scope]);
    if (w && h) {
      this.viewer.renderer.setSize(w, h, false);
      const size = Math.round(Math.min(0.36 * w, 0.55 * h));
      this.hasLens = size >= 180;
      const lens = this.pane.querySelector("#lens").style;
      Object.assign(lens, { width: `${size}px`, height: `${size}px`, right: "10px", bottom: "10px" });
      this.lensAt = [w - size - 9, 11, size - 2]; // inside its border
    }
    if (scope) this.scope.setSize(scope, scope, false);
    this.frame();
  }

  // Take the colours of the page, as they are now.
  paint() {
    this.viewer.renderer.setClearColor(css("paper"), 1);
    for (const line of this.desired) line.material.uniforms.colour.value.set(css("desired"));
    this.floor.material.opacity = Number(css("shadow"));
    this.dirty = true;
  }

  choose({ main = this.main, ghosts = this.ghosts, limits, magnify = this.magnify, close }) {
    Object.assign(this, { main, ghosts, magnify });
    const runs = this.arms.length;
    if (limits !== undefined) this.things.limits[0].visible = limits;
    if (close !== undefined) {
      this.close = close;
      this.frame();
    }
    this.arms.forEach((arm, i) => arm.show(i === main ? "solid" : ghosts ? "ghost" : "hidden"));
    this.desired.forEach((line, i) => (line.visible = i === main));
    // The main run's trail is thin and in front, so that the others show beside it, each wider.
    this.trails.forEach(({ line }, i) => {
      const rank = i === main ? 0 : i < main ? i + 1 : i;
      line.width = 1.8 * (rank + 1);
      line.material.uniforms.lift.value = 0.003 * (1 - rank / runs);
    });
    this.seek(this.time);
  }

  seek(t) {
    const THREE = MeshCat.THREE;
    this.time = t;
    this.data.runs.forEach((run, i) => {
      this.arms[i].pose(t);
      const { line, times } = this.trails[i];
      const [row, share] = times.length ? place(times, t) : [0, 0];
      line.cut(row + (share > 0 ? 1 : 0));
      const pivot = new THREE.Vector3(...sample(run, "pivot", t));
      const slip = new THREE.Vector3(...sample(run, "slip", t));
      this.arrows[i].point(pivot, slip.clone().multiplyScalar(this.magnify));
      if (i === this.main) this.label(slip.length());
      if (i === this.main) this.moving.position.copy(pivot).sub(new THREE.Vector3(...this.data.scene.pivot));
    });
    this.dirty = true;
  }

  render() {
    if (!this.dirty && !this.viewer.needs_render) return;
    this.dirty = false;
    this.draws += 1;
    if (this.pane.clientWidth) this.renderScene();
    if (this.scopePane.clientWidth) this.scope.render(this.viewer.scene, this.inside());
  }

  renderScene() {
    this.viewer.render();
    const box = this.pane.querySelector("#lens");
    box.hidden = !(this.hasLens && !this.close) || this.coversLimits();
    if (!box.hidden) this.renderLens(this.viewer.renderer, this.lens, this.camera);
    const text = this.pane.querySelector("#slip");
    if (text.parentElement !== (box.hidden ? this.pane : box)) (box.hidden ? this.pane : box).append(text);
  }

  // Whether the close-up would lie over the limits that are shown.
  coversLimits() {
    const [limits] = this.things.limits;
    if (!limits.visible) return false;
    const THREE = MeshCat.THREE;
    const { min, max } = new THREE.Box3().setFromObject(limits);
    const [left, bottom, size] = this.lensAt;
    const corners = [min, max].flatMap((a) => [min, max].flatMap((b) => [min, max].map((c) =>
      new THREE.Vector3(a.x, b.y, c.z).project(this.camera))));
    const right = Math.max(...corners.map(({ x }) => ((x + 1) / 2) * this.pane.clientWidth));
    const low = Math.min(...corners.map(({ y }) => ((y + 1) / 2) * this.pane.clientHeight));
    return right > left && low < bottom + size;
  }

  // The trocar and the trail, close, from where the outside camera looks.
  renderLens(renderer, lens, camera) {
    const away = camera.position.clone().sub(this.viewer.controls.target).normalize();
    lens.aspect = 1;
    this.aim(lens, this.workPoints(), away, 1.3);
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

  inside() {
    const { camera } = this.arms[this.main];
    camera.layers.set(0);
    camera.layers.enable(INSIDE_LAYER);
    return camera;
  }

  // How large the RCM error is; it stands in a corner of the close-up, or of the pane without one.
  label(size) {
    const text = this.pane.querySelector("#slip");
    const drawn = this.magnify * size > LEAST_ARROW ? `drawn \u00d7${this.magnify}` : "too small to draw";
    text.textContent = `RCM error ${millimetres(size)}${Number.isNaN(size) ? "" : `, ${drawn}`}`;
  }
}

// A length [m] in millimetres, with three significant digits; what is rounding is not told apart.
function millimetres(x) {
  const mm = 1e3 * x;
  if (Number.isNaN(mm)) return "missing";
  if (mm < 1e-9) return "<1e-9 mm";
  return `${mm < 1e-3 ? mm.toExponential(2) : mm.toPrecision(3)} mm`;
}
