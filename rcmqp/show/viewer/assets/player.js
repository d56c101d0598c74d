// The page's one clock, and everything that it drives: scene, endoscope, plots, legend.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];
const MAGNIFY = [1, 10, 100, 1000, 10000]; // a helix at 1 kHz slips by tenths of a micrometre

const $ = (id) => document.getElementById(id);

for (const kind of ["error", "unhandledrejection"])
  window.addEventListener(kind, (event) => {
    const cause = event.reason ?? event.error;
    if (!cause) return; // a browser's remark
    const why = cause.message ?? String(cause);
    document.documentElement.dataset.failed = why;
    if ($("wait")) $("wait").textContent = `this browser cannot show the run: ${why}`;
  });

// #scene, #endoscope: only that, as large as the window, for pictures.
const solo = ["scene", "endoscope"].find((pane) => `#${pane}` === location.hash);
if (solo) document.body.dataset.solo = solo;

const [meshcat, numbers, plotly] = ["meshcat-gz", "data-gz", "plotly-gz"].map(inflate); // side by side
runScript(await meshcat);
const data = readData(await numbers);
const stage = new Stage($("scene"), $("scope"), data);
const duration = Math.max(...data.runs.map((run) => run.frames.time.at(-1)));
const state = { time: 0, playing: false, speed: 1, main: 0, ghosts: false, limits: false, close: false, magnify: fitting() };
let plots = null;

// The largest magnification that keeps the RCM error, at its largest, within 3 cm.
function fitting() {
  const all = data.runs.flatMap((run) => [...run.curves.rcm_error[1]]);
  const most = Math.max(...all.filter(Number.isFinite));
  return MAGNIFY.findLast((factor) => factor * most <= 30) ?? 1;
}

// Decimals of the clock [s]: short runs have more.
const decimals = Math.max(2, Math.ceil(2 - Math.log10(duration || 1)));

function seek(t) {
  state.time = Math.max(0, Math.min(duration, t));
  const now = state.time.toFixed(decimals);
  stage.seek(state.time);
  plots?.move(state.time);
  $("time").value = state.time;
  $("time").setAttribute("aria-valuetext", `${now} s`);
  $("clock").textContent = `${now} / ${duration.toFixed(decimals)} s`;
  data.runs.forEach((run, i) => {
    const [, tip, rcm, depth] = $("legend").querySelectorAll("tbody tr")[i].cells;
    tip.textContent = millimetres(sample(run, "tip_error", state.time)[0]);
    rcm.textContent = millimetres(Math.hypot(...sample(run, "slip", state.time)));
    const [deep] = sample(run, "depth", state.time);
    depth.textContent = Number.isNaN(deep) ? "missing" : `${(1e3 * deep).toFixed(1)} mm`;
  });
}

function play(on = true) {
  if (on && state.time >= duration) seek(0);
  state.playing = on;
  $("play").innerHTML = on ? "&#10074;&#10074;" : "&#9654;";
  $("play").setAttribute("aria-label", on ? "pause" : "play");
}

function choose(changes) {
  Object.assign(state, changes);
  const { main, ghosts, limits, magnify } = state;
  stage.choose({ main, ghosts, limits, magnify, close: changes.close });
  for (const name of ["ghosts", "limits"]) $(name).setAttribute("aria-pressed", state[name]);
  $("frame").setAttribute("aria-pressed", state.close);
  document.body.toggleAttribute("data-limits", limits); // shows their marks
  $("magnify").value = magnify;
  $("speed").value = state.speed;
  [...$("legend").querySelectorAll("tbody tr")].forEach((row, i) => {
    row.classList.toggle("main", i === main);
    row.querySelector("button").setAttribute("aria-pressed", i === main);
  });
  if (changes.main !== undefined) plots?.draw(main);
}

function theme(name) {
  document.documentElement.dataset.theme = name;
  $("theme").setAttribute("aria-pressed", name === "dark");
  stage.paint();
  plots?.draw(state.main);
}

function step(list, value, by) {
  return list[Math.max(0, Math.min(list.length - 1, list.indexOf(value) + by))];
}

const KEYS = {
  " ": () => play(!state.playing),
  ArrowRight: (event) => seek(state.time + (event.shiftKey ? 1 : 0.05)),
  ArrowLeft: (event) => seek(state.time - (event.shiftKey ? 1 : 0.05)),
  Home: () => seek(0),
  End: () => seek(duration),
  "+": () => choose({ speed: step(SPEEDS, state.speed, 1) }),
  "=": () => choose({ speed: step(SPEEDS, state.speed, 1) }),
  "-": () => choose({ speed: step(SPEEDS, state.speed, -1) }),
  l: () => choose({ limits: !state.limits }),
  g: () => choose({ ghosts: !state.ghosts }),
  f: () => choose({ close: !state.close }),
  b: () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  e: () => choose({ magnify: MAGNIFY[(MAGNIFY.indexOf(state.magnify) + 1) % MAGNIFY.length] }),
};

function furnishControls() {
  for (const value of SPEEDS) $("speed").add(new Option(`\u00d7${value}`, value));
  for (const value of MAGNIFY) $("magnify").add(new Option(`\u00d7${value}`, value));
  $("time").max = duration;
  $("time").addEventListener("input", () => seek(Number($("time").value)));
  $("play").addEventListener("click", () => play(!state.playing));
  $("speed").addEventListener("change", () => choose({ speed: Number($("speed").value) }));
  $("magnify").addEventListener("change", () => choose({ magnify: Number($("magnify").value) }));
  for (const [id, key] of [["limits", "l"], ["ghosts", "g"], ["frame", "f"], ["theme", "b"]])
    $(id).addEventListener("click", () => KEYS[key]());
  $("ghosts").hidden = data.runs.length < 2;
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.tagName === "BUTTON") return; // the button's own
    const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act(event);
  });
  data.runs.forEach((run, i) => {
    const row = $("legend").querySelector("tbody").insertRow();
    for (let cell = 0; cell < 4; cell++) row.insertCell();
    const button = document.createElement("button");
    button.append(mark(`run ${run.dash}`, run.label, { color: run.colour }));
    button.title = "the arm of this run is solid, and the endoscope is its own";
    row.cells[0].append(button);
    row.addEventListener("click", () => choose({ main: i }));
    $("caption").append(mark("solid", run.label, { color: run.colour }));
  });
  // What was clicked does not keep the keys to itself.
  const release = (event) => event.detail !== 0 && document.activeElement.blur();
  for (const button of document.querySelectorAll("button")) button.addEventListener("click", release);
  for (const id of ["time", "speed", "magnify"]) $(id).addEventListener("change", release);
  const { targets, spheres, obstacles } = data.scene;
  const there = {
    "desired tip": [0], target: targets, sphere: spheres, obstacle: obstacles,
    "cone of the shaft": [0], "depths of the tip": [0],
    "safe stop": solo ? [] : data.runs.flatMap((run) => run.stops), // in the plots
  };
  const pie = spheres.map(({ colour }) => `rgb(${colour.map((x) => 255 * x)})`);
  for (const name in there) {
    if (!there[name].length) continue;
    for (const [place, next] of [[$("caption"), null], [$("keys"), $("keys").querySelector("br")]])
      place.insertBefore(mark(name.split(" ")[0], name, name === "sphere" ? { background: `conic-gradient(${pie})` } : {}), next);
  }
}

// A swatch of a kind and style, and what it stands for.
function mark(kind, text, style = {}) {
  const [all, swatch] = ["span", "i"].map((tag) => document.createElement(tag));
  swatch.className = kind;
  Object.assign(swatch.style, style);
  all.className = "mark";
  all.append(swatch, text);
  return all;
}

const PAUSE = 2; // a frame that takes longer is no slow one: the page was out of sight [s]
let last = performance.now();
document.addEventListener("visibilitychange", () => (last = performance.now()));
function tick(now) {
  const passed = Math.min(PAUSE, (now - last) / 1000);
  last = now;
  if (state.playing) {
    seek(state.time + state.speed * passed);
    if (state.time >= duration) play(false);
  }
  stage.render();
  requestAnimationFrame(tick);
}

furnishControls();
theme(document.documentElement.dataset.theme);
stage.resize();
choose({});
seek(0);
$("wait").remove();
requestAnimationFrame(tick);

// For tests, pictures and video. What is changed is drawn with the browser's next frame, or by
// draw(); picture() draws, and returns one pane as a PNG's data URL.
window.rcmqp = {
  duration,
  drawnIn: null, // [ms] from opening the page to the scene on the screen, which can be played
  openedIn: null, // [ms] to all of the page, plots too
  get time() { return state.time; },
  get playing() { return state.playing; },
  get speed() { return state.speed; },
  get draws() { return stage.draws; }, // how often the scene was drawn
  seek,
  play: () => play(true),
  pause: () => play(false),
  choose,
  theme,
  draw: () => stage.render(),
  pose: (run, link) => stage.arms[run].matrix(link),
  // Where the scene's pane shows a point of the world: to the right of and below its corner [px].
  pixel(point) {
    stage.camera.updateMatrixWorld();
    const { x, y } = new MeshCat.THREE.Vector3(...point).project(stage.camera);
    return [((1 + x) / 2) * stage.pane.clientWidth, ((1 - y) / 2) * stage.pane.clientHeight];
  },
  // Corners of boxes around what has a name, in the world [m].
  boxes: (name) => stage.things[name].map((object) => {
    object.updateWorldMatrix(true, true);
    const { min, max } = new MeshCat.THREE.Box3().setFromObject(object);
    return [min.toArray(), max.toArray()];
  }),
  // Points of a run's trail as far as it is drawn, x, y, z one after the other.
  trail(run) {
    const { geometry } = stage.trails[run].line;
    return [...geometry.attributes.end.array.subarray(0, 2 * geometry.drawRange.count)].filter((_, i) => i % 12 < 3);
  },
  // Whether each of what has a name is there; how an arm is: solid, ghost or hidden.
  shown: (name) => stage.things[name].map((object) => object.visible),
  arm: (run) => stage.arms[run].look,
  show(name, on) {
    const own = { arm: stage.arms[state.main].base, desired: stage.desired[state.main] }[name];
    for (const object of own ? [own] : stage.things[name]) object.visible = on;
    stage.dirty = true;
  },
  picture(which = "scene") {
    stage.dirty = true;
    stage.render();
    return (which === "scene" ? stage.viewer.renderer : stage.scope).domElement.toDataURL();
  },
};

const frame = () => new Promise(requestAnimationFrame);
await frame(); // draws the scene
await frame(); // it is on the screen
window.rcmqp.drawnIn = performance.now();

// Plotly is large: the scene can be looked at, and played, while the plots are prepared.
if (!solo) {
  runScript(await plotly);
  plots = new Plots($("plots"), data.runs, seek);
  await plots.draw(state.main);
  plots.move(state.time);
}
window.rcmqp.openedIn = performance.now();
document.documentElement.dataset.ready = "";
