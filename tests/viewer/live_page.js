// A page on live sources: recorded frames are pushed into them one by one. See test_viewer_live.py.

import "../../rcmqp/show/viewer/assets/failures.js";
import { query } from "../../rcmqp/show/viewer/assets/elements.js";
import { unpacked } from "../../rcmqp/show/viewer/assets/packed.js";
import { readRecording } from "../../rcmqp/show/viewer/assets/recording.js";
import { LiveSource } from "../../rcmqp/show/viewer/assets/sources.js";
import { Stage } from "../../rcmqp/show/viewer/assets/stage.js";

const data = readRecording(await unpacked("data-gz"));
const recorded = data.runs.map(({ source }) => source);
const options = Object.fromEntries(new URLSearchParams(location.search));
const sources = recorded.map(() => new LiveSource(data.arm.joints.length, { points: Number(options.points), step: Number(options.step) }));
const runs = data.runs.map((run, i) => ({ ...run, source: sources[i] }));

/** @param {number} t [s] */
function push(t) {
  sources.forEach((source, i) => source.push(t, recorded[i].at(t)));
}

push(0);
const stage = new Stage(query(document, "#scene"), query(document, "#scope"), { ...data, runs });
stage.paint();
stage.resize();
stage.choose({});
query(document, "#wait").remove();

window.rcmqp = {
  /** Push frames, show each, and draw the last one. @param {number[]} times [s] */
  show(times) {
    for (const t of times) {
      push(t);
      stage.seek(sources[0].newest);
    }
    stage.render();
  },
  seek: (/** @type {number} */ t) => stage.seek(t),
  times: [...recorded[0].frames.time],
  newest: () => sources[0].newest,
  frame: () => stage.frame(),
  stretches: () => stage.trails[0].buffers.stretches,
  /** Points of the first run's trail as far as it is drawn. */
  trail() {
    const { starts, ends, geometry } = stage.trails[0].buffers;
    const stretches = geometry.drawRange.count / 6;
    const points = [...Array(stretches).keys()].map((i) => [...ends.subarray(12 * i, 12 * i + 3)]);
    return stretches ? [[...starts.subarray(0, 3)], ...points] : [];
  },
  picture(which = "scene") {
    stage.dirty = true;
    stage.render();
    return (which === "scene" ? stage.viewer.renderer : stage.scope).domElement.toDataURL();
  },
};
document.documentElement.dataset.ready = "";
