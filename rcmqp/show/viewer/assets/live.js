// The live console: the picture of an arm that moves now, and the hand that steers it.

import "./failures.js";
import { unpacked } from "./packed.js";
import { Devices } from "./devices.js";
import { query } from "./elements.js";
import { depth } from "./format.js";
import { Hand } from "./hands.js";
import { Link } from "./link.js";
import { readRecording } from "./recording.js";
import { Slowness } from "./slowness.js";
import { drawsInSoftware } from "./software.js";
import { LiveSource } from "./sources.js";
import { Stage } from "./stage.js";
import { Task, sight } from "./task.js";
import { EVERY, Teller } from "./teller.js";

/** Pictures in light mode: time from one to the next, at least [ms]. */
const LIGHT = 66;
/** Numbers are written so often, and in light mode [ms]. */
const [READ, LIGHT_READ] = [100, 250];
/** An arm whose joints turn less from one picture to the next stands still [rad]. */
const AT_REST = 1e-6;
/** Ages of pictures that the page's own quantiles are of. */
const AGES = 600;

const { scene, arm, runs: [first] } = readRecording(await unpacked("data-gz"));
const source = new LiveSource(arm.joints.length);
source.push(-1, first.source.at(0)); // the arm before the loop begins
const picture = query(document, "#scope");
const software = drawsInSoftware();
const stage = new Stage(
  query(document, "#scene"), picture, { scene, arm, runs: [{ ...first, source }] }, { antialias: !software });
const hand = new Hand();
const page = {
  steers: false, free: false, ended: "", stopped: 0, silent: false, light: false, came: 0, held: false,
};
/** @type {import("./link.js").Live | null} */
let newest = null;
let drawn = { time: -1, at: 0, wrote: 0, angles: first.source.at(0).angles };
/** @type {number[]} */
const ages = [];

/** @type {import("./task.js").Orders | null} */
const orders = JSON.parse(query(document, "#task-data").textContent ?? "null");
const link = new Link({
  state(state) {
    if (!source.push(state.time, state)) return;
    if (hand.held && state.stopped > page.stopped) page.silent = true;
    page.stopped = state.stopped;
    newest = state;
    page.came = performance.now();
    if (state.latency) writeLatency(state.latency);
  },
  role(steers) {
    Object.assign(page, { steers, free: false });
    hand.release(); // what was held meanwhile has to be pressed anew
    write();
  },
  free() {
    page.free = true;
    if (task) link.takeAgain(); // a participant's page that was loaded again
    write();
  },
  ended(why) {
    page.ended ||= why;
    hand.release();
    write();
  },
  next: orders ? () => {
    release();
    link.reload(page.steers);
  } : undefined,
});

const teller = new Teller(hand, { steers: () => page.steers, send: () => link.tell(hand) });
const slowness = new Slowness();
const task = orders && new Task(orders, stage, link);
const devices = new Devices(hand, {
  changed, released: release, draw, picture: stage.scope.domElement, viscosity: () => newest?.viscosity ?? 0,
});

/** After an input. */
function changed() {
  teller.changed();
  if (hand.held !== page.held) write(); // the rest is written with the next picture
}

function release() {
  hand.release();
  changed();
}

/** @param {number[]} times [s] or [ms], median, p95, p99 @param {number} to milliseconds */
function quantiles(times, to) {
  return times.slice(0, 3).map((time) => (to * time).toFixed(1)).join(" / ");
}

/** A length, as fine as it matters. @param {number} x [m] */
const short = (x) => (x < 1e-6 ? "<0.001 mm" : `${(1e3 * x).toFixed(3)} mm`);

/** @param {Record<string, number[]>} latency */
function writeLatency({ input, state }) {
  const sorted = [...ages].sort((a, b) => a - b);
  const rows = { "event-command": input, "command-state": state };
  for (const [id, times] of Object.entries(rows))
    query(document, `#${id}`).textContent = times[3] ? quantiles(times, 1000) : "\u2013";
  if (sorted.length)
    query(document, "#state-picture").textContent = quantiles([0.5, 0.95, 0.99].map((p) => sorted[Math.floor(p * sorted.length)]), 1);
}

/** Set an element's text only if it changes. @param {string} where @param {string} text */
function put(where, text) {
  const element = query(document, where);
  if (element.textContent !== text) element.textContent = text;
}

/** What the operator has to know, and the errors. */
function write() {
  const held = (page.held = hand.held);
  if (!held) page.silent = false;
  /** @type {[string, string]} */
  const said =
    page.ended ? ["ended", page.ended] :
    !page.steers ? ["watch", page.free ? "nobody steers" : "somebody else steers; you watch"] :
    task && !newest ? ["rest", "press start when you are ready"] :
    page.silent ? ["stopped", `stopped after ${task ? "a delay" : "100 ms of silence"}: let go and hold again`] :
    held ? ["held", "you hold the camera"] :
    ["rest", newest?.moving ? "coming to rest" : "at rest: hold the picture and drag"];
  document.body.dataset.said = said[0];
  put("#said", said[1]);
  query(document, "#take").hidden = page.steers || page.ended !== "" || !page.free;
  slowness.see(page.ended ? 0 : newest?.skipped ?? 0, performance.now() - page.came);
  document.body.classList.toggle("slow", slowness.on);
  put("#slower", String(slowness.percent));
  put("#slow-said", slowness.on ? "The loop is too slow." : "");
  task?.write(page.steers && !page.ended, newest);
  if (!newest) return;
  put("#rcm", short(Math.hypot(...Array.from(newest.slip))));
  put("#depth", depth(newest.depth[0]));
  put("#lag", short(newest.tip_error[0]));
  put("#time", `${newest.time.toFixed(page.light ? 0 : 1)} s`);
}

/** @param {PointerEvent} event @returns {[number, number]} */
const spot = (event) => [event.clientX, event.clientY];

picture.addEventListener("pointerdown", (event) => {
  if (!page.steers || page.ended || (event.pointerType === "mouse" && event.button !== 0)) return;
  picture.setPointerCapture(event.pointerId);
  hand.down(event.pointerId, spot(event), event.pointerType || "mouse");
  changed();
});
/** @param {PointerEvent} event */
function drag(event) {
  const how = { size: picture.clientWidth, shift: event.shiftKey, at: event.timeStamp };
  hand.drag(event.pointerId, spot(event), how);
  if (hand.event !== null) changed();
}
// A move waits for the next picture, which software takes long for. Where the browser tells of it
// at once, too, there is nothing left to do for the move.
picture.addEventListener("pointermove", drag);
picture.addEventListener("pointerrawupdate", (event) => drag(/** @type {PointerEvent} */ (event)));
for (const kind of /** @type {const} */ (["pointerup", "pointercancel", "lostpointercapture"]))
  picture.addEventListener(kind, (event) => {
    if (!hand.pointers.has(event.pointerId)) return;
    hand.up(event.pointerId);
    changed();
  });
picture.addEventListener("wheel", (event) => {
  event.preventDefault();
  hand.wheel(Math.sign(event.deltaY) * Math.min(1, Math.abs(event.deltaY) / 100), event.timeStamp);
  if (hand.event !== null) changed();
}, { passive: false });
picture.addEventListener("contextmenu", (event) => event.preventDefault());
window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !page.steers || page.ended) return;
  if (event.repeat) {
    if (hand.others.has(event.code)) event.preventDefault();
  } else if (hand.press(event.code)) {
    event.preventDefault();
    changed();
  }
});
window.addEventListener("keyup", ({ code }) => {
  hand.lift(code);
  changed();
});
window.addEventListener("blur", release);
window.addEventListener("pagehide", release);
document.addEventListener("visibilitychange", () => { if (document.hidden) release(); });

let last = performance.now();
setInterval(() => {
  const now = performance.now();
  const passed = Math.min(0.1, (now - last) / 1000);
  last = now;
  devices.tick(passed, now);
  if (!page.steers || page.ended) hand.release();
  hand.tick(passed, now);
  teller.tick();
}, EVERY);

/** Without a graphics card: coarser, without shadows. @param {boolean} on */
function light(on) {
  page.light = on;
  stage.lighten(on);
  query(document, "#light").setAttribute("aria-pressed", String(on));
  query(document, "#why").textContent = on && software ? "no graphics card: coarser pictures; press light for finer ones" : "";
}

/** @param {boolean} on */
function showScene(on) {
  query(document, "#scene").hidden = !on;
  query(document, "#show").setAttribute("aria-pressed", String(on));
  stage.resize();
}

query(document, "#light").addEventListener("click", () => light(!page.light));
query(document, "#show").addEventListener("click", () => showScene(query(document, "#scene").hidden !== false));
query(document, "#take").addEventListener("click", () => link.take());
for (const button of document.querySelectorAll("button")) button.addEventListener("click", () => button.blur());

/** @param {number} now [ms] */
function loop(now) {
  if (page.light) setTimeout(() => requestAnimationFrame(loop), LIGHT - EVERY);
  else requestAnimationFrame(loop);
  draw(now);
}

/** Draw the newest state, if the arm has moved. @param {number} now [ms] @returns {number} how many were drawn */
function draw(now) {
  if (now - drawn.wrote > (page.light ? LIGHT_READ : READ)) {
    drawn.wrote = now;
    write();
  }
  if (page.light && now - drawn.at < LIGHT - EVERY) return stage.draws;
  const { angles } = drawn;
  if (newest && newest.time !== drawn.time && Array.from(newest.angles).some((angle, i) => Math.abs(angle - angles[i]) > AT_REST)) {
    drawn = { ...drawn, time: newest.time, at: now, angles: newest.angles };
    stage.seek(source.newest);
    stage.render();
    ages.push(link.saw(newest));
    if (ages.length > AGES) ages.shift();
  } else stage.render();
  return stage.draws;
}

stage.paint();
stage.choose({ close: true });
light(software);
showScene(!task && !page.light && window.innerWidth > 900);
stage.seek(source.newest);
task?.draw();
query(document, "#wait").remove();
write();
requestAnimationFrame(loop);

window.rcmqp = {
  get newest() { return newest; },
  get steers() { return page.steers; },
  get told() { return link.number; },
  get held() { return hand.held; },
  get way() { return hand.way; },
  get clock() { return link.ahead; },
  get draws() { return stage.draws; },
  /** Spheres as the picture shows them now, and as the task's pictures do: see sight(). */
  get sights() { return sight(stage, stage.arms[0].camera); },
  get wanted() { return task?.cameras.map((camera) => sight(stage, camera)) ?? []; },
  get said() { return query(document, "#said").textContent; },
  /** Where a point stands in the endoscope's picture, from its middle, right and down. @param {number[]} point [m] */
  seen(point) {
    stage.seek(source.newest);
    const { camera } = stage.arms[0];
    camera.updateWorldMatrix(true, false);
    const at = camera.position.clone().fromArray(point).project(camera);
    return [at.x, -at.y];
  },
};
document.documentElement.dataset.ready = "";
