// What a page of recorded runs carries: a header, and blocks of bytes that it points to.

import { RecordedSource } from "./sources.js";

/**
 * A curve of a plot: times [s] and values.
 * @typedef {[Float32Array, Float32Array]} Curve
 */

/**
 * A sphere in the world; centre and radius [m].
 * @typedef {{centre: number[], radius: number}} Sphere
 */

/**
 * Sizes [m], the mount on the flange, column after column, and the camera [rad].
 * @typedef {object} Instrument
 * @property {number} length
 * @property {number} radius
 * @property {number} mount_offset
 * @property {number[]} mount
 * @property {number} field_of_view
 * @property {number} angle
 * @property {number} roll
 * @property {number[]} wrist from each of its joints to the next, and from the last to the tool
 */

/**
 * What stands around the arm: surroundings() in scene.py.
 * @typedef {object} Surroundings
 * @property {number[]} pivot the trocar at first, in the world [m]
 * @property {number[]} axis of the trocar, into the patient
 * @property {number} cone_half_angle [rad]
 * @property {[number, number]} depth_range [m]
 * @property {Instrument} instrument
 * @property {Sphere[]} obstacles
 * @property {number[][]} targets tips that are asked for [m]
 * @property {(Sphere & {colour: number[]})[]} spheres that a camera task asks to be shown
 * @property {number[][]} skeleton the arm's joints from base to tip [m]
 * @property {number} deepest how far from the trocar tips come [m]
 */

/**
 * The arm: kinematics() and commands() in scene.py.
 * @typedef {object} ArmShape
 * @property {{name: string, placement: number[], linear: number[], angular: number[]}[]} joints
 * @property {number[]} flange its placement on its joint, column after column
 * @property {number} flange_joint counted from 1; joints beyond are those of the wrist
 * @property {Uint8Array[]} commands Meshcat's, which build the arm
 * @property {{path: string[], colour: number[]}[]} parts
 */

/**
 * A run as the page shows it.
 * @typedef {object} Shown
 * @property {string} label
 * @property {string} colour
 * @property {"solid" | "dashed" | "dashdot" | "dotted"} dash
 * @property {import("./sources.js").FrameSource} source
 */

/**
 * A recorded run: besides, curves over time and safe stops, begin and end [s].
 * @typedef {Shown & {source: RecordedSource, curves: {[name: string]: Curve}, stops: [number, number][]}} Recorded
 */

/**
 * Take the page's data apart.
 *
 * @param {ArrayBuffer} buffer Bundle.text() in bundle.py: length of the header, header, block
 * @returns {{scene: Surroundings, arm: ArmShape, runs: Recorded[]}}
 */
export function readRecording(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const data = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const start = 4 + size;
  /** @param {{at: number, shape: number[]}} entry */
  const floats = ({ at, shape }) =>
    new Float32Array(buffer, start + at, shape.reduce((a, b) => a * b, 1));
  /** @param {{at: number, size: number}} entry */
  const bytes = ({ at, size: length }) => new Uint8Array(buffer, start + at, length);
  data.arm.commands = data.arm.commands.map(bytes);
  for (const run of data.runs) {
    for (const name in run.frames) run.frames[name] = floats(run.frames[name]);
    for (const name in run.curves) run.curves[name] = run.curves[name].map(floats);
    run.source = new RecordedSource(run.frames);
    delete run.frames;
  }
  return data;
}
