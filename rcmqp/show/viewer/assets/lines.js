// Lines of a width in pixels, whatever the distance: WebGL's own are one pixel wide.

import { THREE } from "./meshcat.js";

/** @import { WebGLRenderer } from "three" */

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

/** Along and across a stretch, of its four corners, and the two triangles that they make. */
const CORNERS = [0, -1, 1, -1, 1, 1, 0, 1];
const TRIANGLES = [0, 1, 2, 0, 2, 3];

/**
 * Buffers for some stretches; nothing is in them. Four corners a stretch: instances are slow
 * without a graphics card.
 *
 * @param {number} stretches
 */
function makeBuffers(stretches) {
  const corners = new Float32Array(8 * stretches);
  const index = new Uint32Array(6 * stretches);
  for (let i = 0; i < stretches; i++) {
    corners.set(CORNERS, 8 * i);
    for (let k = 0; k < 6; k++) index[6 * i + k] = 4 * i + TRIANGLES[k];
  }
  const starts = new Float32Array(12 * stretches);
  const ends = new Float32Array(12 * stretches);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(starts, 3));
  geometry.setAttribute("end", new THREE.BufferAttribute(ends, 3));
  geometry.setAttribute("corner", new THREE.BufferAttribute(corners, 2));
  geometry.setIndex(new THREE.BufferAttribute(index, 1));
  return { stretches, starts, ends, geometry };
}

/** A line along a trail, which grows as the trail does. */
export class TrailLine extends THREE.Mesh {
  /**
   * @param {import("./trail.js").Trail} trail
   * @param {string} colour as CSS writes it
   * @param {number} width [px]
   */
  constructor(trail, colour, width) {
    const uniforms = {
      colour: { value: new THREE.Color(colour) },
      resolution: { value: new THREE.Vector2(1, 1) },
      width: { value: width },
      lift: { value: 0 }, // brings it before what is as near [m]
    };
    const material = new THREE.ShaderMaterial({
      uniforms, vertexShader: LINE_VERTEX, fragmentShader: LINE_FRAGMENT, side: THREE.DoubleSide,
    });
    const buffers = makeBuffers(Math.max(0, trail.count - 1));
    super(buffers.geometry, material);
    this.buffers = buffers;
    this.trail = trail;
    this.uniforms = uniforms;
    this.width = width;
    this.drawn = 0; // points of the trail that are in the buffers
    this.dropped = trail.dropped; // when they were put there
    this.frustumCulled = false;
    this.follow();
    const port = new THREE.Vector4();
    this.onBeforeRender = (/** @type {WebGLRenderer} */ renderer) => {
      renderer.getCurrentViewport(port);
      uniforms.resolution.value.set(port.z, port.w);
      uniforms.width.value = this.width * renderer.getPixelRatio();
      material.uniformsNeedUpdate = true;
    };
  }

  raycast() {}

  /** Put what the trail has won since into the buffers, which grow if they are too small. */
  follow() {
    const { count, dropped, points } = this.trail;
    if (this.drawn === count && this.dropped === dropped) return;
    const needed = Math.max(0, count - 1);
    if (needed > this.buffers.stretches) {
      this.buffers.geometry.dispose();
      this.buffers = makeBuffers(Math.max(needed, 2 * this.buffers.stretches));
      this.geometry = this.buffers.geometry;
      this.drawn = 0;
    }
    const { starts, ends, geometry } = this.buffers;
    for (let i = this.dropped === dropped ? Math.max(0, this.drawn - 1) : 0; i < needed; i++)
      for (let k = 0; k < 4; k++) {
        starts.set(points.subarray(3 * i, 3 * i + 3), 12 * i + 3 * k);
        ends.set(points.subarray(3 * i + 3, 3 * i + 6), 12 * i + 3 * k);
      }
    geometry.attributes.position.needsUpdate = geometry.attributes.end.needsUpdate = true;
    geometry.setDrawRange(0, 6 * needed);
    this.drawn = count;
    this.dropped = dropped;
  }

  /** Draw it as far as the trail goes at a time. @param {number} t [s] */
  cut(t) {
    this.follow();
    this.buffers.geometry.setDrawRange(0, 6 * this.trail.stretches(t));
  }
}
