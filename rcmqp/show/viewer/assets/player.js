// The page of recorded runs: one clock, and everything that it drives.

import "./failures.js";
import { runLibrary, unpacked } from "./packed.js";
import { Clock, SPEEDS } from "./clock.js";
import { input, query } from "./elements.js";
import { clockText, decimals } from "./format.js";
import { Legend, addMarks } from "./legend.js";
import { Plots } from "./plots.js";
import { readRecording } from "./recording.js";
import { MAGNIFY, fitting, step } from "./scales.js";
import { Stage } from "./stage.js";
import { THREE } from "./meshcat.js";

// #scene, #endoscope: only that, as large as the window, for pictures.
const solo = ["scene", "endoscope"].find((pane) => `#${pane}` === location.hash);
if (solo) document.body.dataset.solo = solo;

const data = readRecording(await unpacked("data-gz"));
const clock = new Clock(data.runs.map(({ source }) => source));
const stage = new Stage(query(document, "#scene"), query(document, "#scope"), data);
const legend = new Legend(data.runs, (main) => choose({ main }));
const root = document.documentElement;
const state = {
  main: 0, ghosts: false, limits: false, close: false, magnify: fitting(data.runs.map((run) => run.curves.rcm_error[1])),
};
/** @type {Plots | null} */
let plots = null;

/** @param {number} t [s] */
function seek(t) {
  clock.seek(t);
  legend.write(stage.seek(clock.time));
  plots?.move(clock.time);
  input("time").value = String(clock.time);
  input("time").setAttribute("aria-valuetext", `${clock.time.toFixed(decimals(clock.duration))} s`);
  query(document, "#clock").textContent = clockText(clock.time, clock.duration);
}

function play(on = true) {
  const before = clock.time;
  if (on) clock.play();
  else clock.pause();
  if (clock.time !== before) seek(clock.time); // from the beginning again
  query(document, "#play").textContent = clock.playing ? "\u275a\u275a" : "\u25b6";
  query(document, "#play").setAttribute("aria-label", clock.playing ? "pause" : "play");
}

/** Change what is shown, or the speed. @param {Partial<typeof state> & {speed?: number}} changes */
function choose({ speed = clock.speed, ...changes }) {
  Object.assign(state, changes);
  clock.speed = speed;
  const { main, ghosts, limits, magnify, close } = state;
  stage.choose({ main, ghosts, limits, magnify, close: changes.close });
  for (const [id, on] of Object.entries({ ghosts, limits, frame: close }))
    query(document, `#${id}`).setAttribute("aria-pressed", String(on));
  document.body.toggleAttribute("data-limits", limits); // shows their marks
  input("magnify").value = String(magnify);
  input("speed").value = String(speed);
  legend.choose(main);
  if (changes.main !== undefined) plots?.draw(main);
}

/** @param {string | undefined} name "light" or "dark" */
function theme(name) {
  root.dataset.theme = name;
  query(document, "#theme").setAttribute("aria-pressed", String(name === "dark"));
  stage.paint();
  plots?.draw(state.main);
}

/** @type {Record<string, (isShifted: boolean) => void>} */
const KEYS = {
  " ": () => play(!clock.playing),
  ArrowRight: (isShifted) => seek(clock.time + (isShifted ? 1 : 0.05)),
  ArrowLeft: (isShifted) => seek(clock.time - (isShifted ? 1 : 0.05)),
  Home: () => seek(0),
  End: () => seek(clock.end),
  "+": () => choose({ speed: step(SPEEDS, clock.speed, 1) }),
  "=": () => choose({ speed: step(SPEEDS, clock.speed, 1) }),
  "-": () => choose({ speed: step(SPEEDS, clock.speed, -1) }),
  l: () => choose({ limits: !state.limits }),
  g: () => choose({ ghosts: !state.ghosts }),
  f: () => choose({ close: !state.close }),
  b: () => theme(root.dataset.theme === "dark" ? "light" : "dark"),
  e: () => choose({ magnify: MAGNIFY[(MAGNIFY.indexOf(state.magnify) + 1) % MAGNIFY.length] }),
};

/** @param {KeyboardEvent} event */
function press(event) {
  const at = event.target instanceof Element ? event.target.tagName : "";
  if (event.ctrlKey || event.metaKey || event.altKey || at === "SELECT") return;
  if (event.key === " " && at === "BUTTON") return; // the button's own
  const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!act) return;
  event.preventDefault();
  act(event.shiftKey);
}

function furnishControls() {
  for (const [id, values] of Object.entries({ speed: SPEEDS, magnify: MAGNIFY }))
    query(document, `#${id}`).append(...values.map((value) => new Option(`\u00d7${value}`, String(value))));
  query(document, "#time").setAttribute("max", String(clock.end));
  input("time").addEventListener("input", () => seek(Number(input("time").value)));
  query(document, "#play").addEventListener("click", () => play(!clock.playing));
  input("speed").addEventListener("change", () => choose({ speed: Number(input("speed").value) }));
  input("magnify").addEventListener("change", () => choose({ magnify: Number(input("magnify").value) }));
  for (const [id, key] of [["limits", "l"], ["ghosts", "g"], ["frame", "f"], ["theme", "b"]])
    query(document, `#${id}`).addEventListener("click", () => KEYS[key](false));
  query(document, "#ghosts").hidden = data.runs.length < 2;
  window.addEventListener("keydown", press);
  // What was clicked does not keep the keys to itself.
  /** @param {UIEvent | Event} event */
  const release = (event) => {
    const { activeElement } = document;
    if (!("detail" in event && event.detail === 0) && activeElement instanceof HTMLElement) activeElement.blur();
  };
  for (const button of document.querySelectorAll("button")) button.addEventListener("click", release);
  for (const id of ["time", "speed", "magnify"]) input(id).addEventListener("change", release);
  addMarks(data.scene, !solo && data.runs.some((run) => run.stops.length > 0)); // stops are in the plots
}

let last = performance.now();
document.addEventListener("visibilitychange", () => (last = performance.now()));
/** @param {number} now [ms] */
function tick(now) {
  const passed = (now - last) / 1000;
  last = now;
  if (clock.playing) {
    clock.tick(passed);
    seek(clock.time);
    if (!clock.playing) play(false);
  }
  stage.render();
  requestAnimationFrame(tick);
}

furnishControls();
theme(root.dataset.theme);
stage.resize();
choose({});
seek(0);
query(document, "#wait").remove();
requestAnimationFrame(tick);

// For tests, pictures and video. What is changed is drawn with the browser's next frame, or by
// draw(); picture() draws, and returns one pane as a PNG's data URL.
const handle = {
  duration: clock.duration,
  /** From opening the page to the scene on the screen, which can be played [ms]. @type {number | null} */
  drawnIn: null,
  /** To all of the page, plots too [ms]. @type {number | null} */
  openedIn: null,
  get time() { return clock.time; },
  get playing() { return clock.playing; },
  get speed() { return clock.speed; },
  get draws() { return stage.draws; }, // how often the scene was drawn
  seek,
  play: () => play(true),
  pause: () => play(false),
  choose,
  theme,
  draw: () => stage.render(),
  /** @param {number[] | null} from direction of length 1 to the outside camera @param {number} zoom */
  look(from, zoom) {
    Object.assign(stage, { from, zoom });
    stage.frame();
  },
  /** Take away the ground behind the scene. */
  clear() {
    const style = document.createElement("style");
    style.textContent = "html, body, #scene { background: transparent !important; }";
    document.head.append(style);
    stage.ground = 0;
    stage.paint();
  },
  /** @param {number} run @param {string} link */
  pose: (run, link) => stage.arms[run].matrix(link),
  /** Where the scene's pane shows a point: right of and below its corner [px]. @param {number[]} point [m] */
  pixel(point) {
    stage.camera.updateMatrixWorld();
    const { x, y } = new THREE.Vector3().fromArray(point).project(stage.camera);
    return [((1 + x) / 2) * stage.pane.clientWidth, ((1 - y) / 2) * stage.pane.clientHeight];
  },
  /** Corners of boxes around what has a name, in the world [m]. @param {string} name */
  boxes: (name) => stage.things[name].map((object) => {
    object.updateWorldMatrix(true, true);
    const { min, max } = new THREE.Box3().setFromObject(object);
    return [min.toArray(), max.toArray()];
  }),
  /** Points of a run's trail as far as it is drawn, x, y, z one after the other. @param {number} run */
  trail(run) {
    const { ends, geometry } = stage.trails[run].buffers;
    return Array.from(ends).slice(0, 2 * geometry.drawRange.count).filter((_, i) => i % 12 < 3);
  },
  /** Whether each of what has a name is there. @param {string} name */
  shown: (name) => stage.things[name].map((object) => object.visible),
  /** How an arm is shown: solid, ghost or hidden. @param {number} run */
  arm: (run) => stage.arms[run].look,
  /** @param {string} name of things, "arm" or "desired" for the main run's @param {boolean} on */
  show(name, on) {
    const own = name === "arm" ? stage.arms[state.main].base : name === "desired" ? stage.desired[state.main] : null;
    for (const object of own ? [own] : stage.things[name]) object.visible = on;
    stage.dirty = true;
  },
  picture(which = "scene") {
    stage.dirty = true;
    stage.render();
    return (which === "scene" ? stage.viewer.renderer : stage.scope).domElement.toDataURL();
  },
};
window.rcmqp = handle;

const nextFrame = () => new Promise(requestAnimationFrame);
await nextFrame(); // draws the scene
await nextFrame(); // it is on the screen
handle.drawnIn = performance.now();

// Plotly is large: the scene can be looked at, and played, while the plots are prepared.
if (!solo) {
  await runLibrary("plotly-gz");
  plots = new Plots(query(document, "#plots"), data.runs, seek);
  await plots.draw(state.main);
  plots.move(clock.time);
}
handle.openedIn = performance.now();
root.dataset.ready = "";
