// Lines of a width in pixels, whatever the distance: WebGL's own are one pixel wide.

const LINE_VERTEX = `
  attribute vec3 end;
  attribute vec2 corner;
  uniform vec2 resolution;
  uniform float width, lift;
  void main() {
    vec4 a = modelViewMatrix * vec4(position, 1.0), b = modelViewMatrix * vec4(end, 1.0);
    float near = -1.001 * projectionMatrix[3][2] / (projectionMatrix[2][2] - 1.0);
    if (a.z > near && b.z > near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    if (a.z > near) a = mix(a, b, (near - a.z) / (b.z - a.z));
    if (b.z > near) b = mix(b, a, (near - b.z) / (a.z - b.z));
    a.xyz *= max(0.5, 1.0 + lift / a.z); // nearer to the camera, at the same place in the image
    b.xyz *= max(0.5, 1.0 + lift / b.z);
    vec4 ca = projectionMatrix * a, cb = projectionMatrix * b;
    vec2 along = (cb.xy / cb.w - ca.xy / ca.w) * resolution;
    along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
    vec2 offset = corner.y * vec2(-along.y, along.x) + (2.0 * corner.x - 1.0) * 0.5 * along;
    gl_Position = corner.x < 0.5 ? ca : cb;
    gl_Position.xy += offset * width / resolution * gl_Position.w;
  }`;

const LINE_FRAGMENT = `
  uniform vec3 colour;
  void main() { gl_FragColor = vec4(colour, 1.0); }`;

// A line through points (x, y, z, x, y, z, ...); lift [m] brings it before what is as near.
function thickLine(points, colour, width, lift = 0) {
  const THREE = MeshCat.THREE;
  const geometry = new THREE.BufferGeometry();
  const count = Math.max(0, points.length / 3 - 1);
  const starts = new Float32Array(12 * count); // four corners a stretch: instances are slow without
  const ends = new Float32Array(12 * count); // a graphics card
  const corners = new Float32Array(8 * count);
  const index = new Uint32Array(6 * count);
  for (let i = 0; i < count; i++) {
    for (let k = 0; k < 4; k++) {
      starts.set(points.subarray(3 * i, 3 * i + 3), 12 * i + 3 * k);
      ends.set(points.subarray(3 * i + 3, 3 * i + 6), 12 * i + 3 * k);
    }
    corners.set([0, -1, 1, -1, 1, 1, 0, 1], 8 * i);
    index.set([0, 1, 2, 0, 2, 3].map((k) => 4 * i + k), 6 * i);
  }
  geometry.setAttribute("position", new THREE.BufferAttribute(starts, 3));
  geometry.setAttribute("end", new THREE.BufferAttribute(ends, 3));
  geometry.setAttribute("corner", new THREE.BufferAttribute(corners, 2));
  geometry.setIndex(new THREE.BufferAttribute(index, 1));
  const uniforms = {
    colour: { value: new THREE.Color(colour) },
    resolution: { value: new THREE.Vector2(1, 1) },
    width: { value: width },
    lift: { value: lift },
  };
  const material = new THREE.ShaderMaterial({
    uniforms, vertexShader: LINE_VERTEX, fragmentShader: LINE_FRAGMENT, side: THREE.DoubleSide,
  });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.width = width;
  mesh.frustumCulled = false;
  mesh.raycast = () => {};
  mesh.cut = (stretches) => geometry.setDrawRange(0, 6 * stretches); // only the first of them
  const port = new THREE.Vector4();
  mesh.onBeforeRender = (renderer) => {
    renderer.getCurrentViewport(port);
    uniforms.resolution.value.set(port.z, port.w);
    uniforms.width.value = mesh.width * renderer.getPixelRatio();
    material.uniformsNeedUpdate = true;
  };
  return mesh;
}

// The way of a tip, without the stretches where it stands still, and the time at each point.
function trail(run, name, still = 2e-5) {
  const path = run.frames[name];
  const points = [];
  const times = [];
  for (let i = 0; i < run.frames.time.length; i++) {
    const p = path.subarray(3 * i, 3 * i + 3);
    if (p.some(Number.isNaN)) continue;
    const n = points.length;
    const far = n === 0 || Math.hypot(p[0] - points[n - 3], p[1] - points[n - 2], p[2] - points[n - 1]) > still;
    if (!far) continue;
    points.push(...p);
    times.push(run.frames.time[i]);
  }
  return { points: new Float32Array(points), times };
}
