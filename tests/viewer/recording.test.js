import assert from "node:assert/strict";
import { test } from "node:test";

import { readRecording } from "../../rcmqp/show/viewer/assets/recording.js";

test("header, numbers and Meshcat's commands come out of the block where the header says", () => {
  const header = {
    scene: { pivot: [1, 2, 3] },
    arm: { commands: [{ at: 24, size: 3 }] },
    runs: [{
      label: "a", stops: [[1, 2]],
      frames: { time: { at: 0, shape: [2] }, tip: { at: 0, shape: [2, 3] } },
      curves: { tip_error: [{ at: 0, shape: [2] }, { at: 16, shape: [2] }] },
    }],
  };
  const text = JSON.stringify(header);
  const head = new TextEncoder().encode(text + " ".repeat(-text.length & 3));
  const buffer = new ArrayBuffer(4 + head.length + 28);
  new DataView(buffer).setUint32(0, head.length, true);
  new Uint8Array(buffer).set(head, 4);
  new Float32Array(buffer, 4 + head.length, 6).set([0, 1, 2, 3, 4, 5]);
  new Uint8Array(buffer).set([7, 8, 9], 4 + head.length + 24);

  const { scene, arm, runs } = readRecording(buffer);
  assert.deepEqual(scene.pivot, [1, 2, 3]);
  assert.deepEqual([...arm.commands[0]], [7, 8, 9]);
  assert.deepEqual(runs[0].curves.tip_error.map((part) => [...part]), [[0, 1], [4, 5]]);
  assert.deepEqual(runs[0].stops, [[1, 2]]);
  assert.equal(runs[0].source.duration, 1);
  assert.deepEqual(runs[0].source.at(0.5).tip, [1.5, 2.5, 3.5]);
});
