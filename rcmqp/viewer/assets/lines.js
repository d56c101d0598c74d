// Lines of a width in pixels, whatever the distance: WebGL's own are one pixel wide.

const LINE_VERTEX = `
  attribute vec3 start, end;
  uniform vec2 resolution;
  uniform float width, lift;
  void main() {
    vec4 a = modelViewMatrix * vec4(start, 1.0), b = modelViewMatrix * vec4(end, 1.0);
    float near = -1.001 * projectionMatrix[3][2] / (projectionMatrix[2][2] - 1.0);
    if (a.z > near && b.z > near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
    if (a.z > near) a = mix(a, b, (near - a.z) / (b.z - a.z));
    if (b.z > near) b = mix(b, a, (near - b.z) / (a.z - b.z));
    a.xyz *= max(0.5, 1.0 + lift / a.z); // nearer to the camera, at the same place in the image
    b.xyz *= max(0.5, 1.0 + lift / b.z);
    vec4 ca = projectionMatrix * a, cb = projectionMatrix * b;
    vec2 along = (cb.xy / cb.w - ca.xy / ca.w) * resolution;
    along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
    vec2 offset = position.y * vec2(-along.y, along.x) + (2.0 * position.x - 1.0) * 0.5 * along;
    gl_Position = position.x < 0.5 ? ca : cb;
    gl_Position.xy += offset * width / resolution * gl_Position.w;
  }`;

const LINE_FRAGMENT = `
  uniform vec3 colour;
  void main() { gl_FragColor = vec4(colour, 1.0); }`;

// A line through points (x, y, z, x, y, z, ...); lift [m] brings it before what is as near.
function thickLine(points, colour, width, lift = 0) {
  const THREE = MeshCat.THREE;
  const geometry = new THREE.InstancedBufferGeometry();
  const corners = [0, -1, 0, 1, -1, 0, 1, 1, 0, 0, 1, 0];
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  const count = Math.max(0, points.length / 3 - 1);
  const line = new THREE.InstancedInterleavedBuffer(new Float32Array(6 * count), 6, 1);
  for (let i = 0; i < count; i++) line.array.set(points.slice(3 * i, 3 * i + 6), 6 * i);
  geometry.setAttribute("start", new THREE.InterleavedBufferAttribute(line, 3, 0));
  geometry.setAttribute("end", new THREE.InterleavedBufferAttribute(line, 3, 3));
  geometry.instanceCount = count;
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
    const n = points.length;
    const far = n === 0 || Math.hypot(p[0] - points[n - 3], p[1] - points[n - 2], p[2] - points[n - 1]) > still;
    if (!far) continue;
    points.push(...p);
    times.push(run.frames.time[i]);
  }
  return { points: new Float32Array(points), times };
}
