// Errors, joint speed and singular value over time, with a cursor, by plotly.

import { query } from "./elements.js";
import { largest, logarithmic } from "./scales.js";
import { css } from "./scenery.js";

/** @typedef {import("./recording.js").Recorded} Recorded */

const PLOTS = [
  ["tip_error", "tip error [mm]"],
  ["rcm_error", "RCM error [mm]"],
  ["speed_ratio", "joint speed / limit"],
  ["singular_value", "least singular value"],
];
const DASHES = { solid: "solid", dashed: "dash", dashdot: "dashdot", dotted: "dot" }; // as plotly calls them
const GAP = 0.085; // between two plots
const HEIGHT = (1 - GAP * (PLOTS.length - 1)) / PLOTS.length;

export class Plots {
  /**
   * @param {HTMLElement} pane with #figure and #cursor in it
   * @param {Recorded[]} runs
   * @param {(t: number) => void} seek is called with a time that is clicked on
   */
  constructor(pane, runs, seek) {
    this.runs = runs;
    this.figure = /** @type {PlotlyFigure} */ (query(pane, "#figure"));
    this.cursor = query(pane, "#cursor");
    this.time = 0;
    this.isWatched = false;
    /** @param {PointerEvent} event */
    const jump = (event) => {
      const axis = this.figure._fullLayout.xaxis;
      const at = event.clientX - this.figure.getBoundingClientRect().left - axis._offset;
      if (at >= -4 && at <= axis._length + 4) seek(axis.p2l(at));
    };
    this.figure.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      this.figure.setPointerCapture(event.pointerId); // plotly covers the page while a button is down
      jump(event);
    }, true);
    this.figure.addEventListener("pointermove", (event) => event.buttons & 1 && jump(event), true);
  }

  /** Values of each run. @param {string} name of the plot */
  curves(name) {
    return this.runs.map((run) => run.curves[name][1]);
  }

  /** Draw all. @param {number} main the run whose curves are a little wider */
  async draw(main) {
    const traces = PLOTS.flatMap(([name], row) => this.runs.map((run, i) => {
      const [x, y] = run.curves[name];
      return { x, y, yaxis: yAxis(row), type: "scatter", mode: x.length > 1 ? "lines" : "markers", name: run.label,
        line: { color: run.colour, width: i === main ? 1.8 : 1.3, dash: DASHES[run.dash] },
        hovertemplate: "%{y:.4~g}<extra></extra>" };
    }));
    await Plotly.react(this.figure, traces, this.layout(), { displayModeBar: false, responsive: true });
    if (!this.isWatched) this.figure.on("plotly_afterplot", () => this.move(this.time)); // resized
    this.isWatched = true;
    this.move(this.time);
  }

  layout() {
    const grid = { gridcolor: css("line"), linecolor: css("soft"), zeroline: false, automargin: false };
    const stops = this.runs.flatMap((run) => run.stops.map(([x0, x1]) => ({ // where it stopped safely
      type: "rect", x0, x1, yref: "paper", y0: 0, y1: 1, layer: "below", opacity: 0.18,
      fillcolor: run.colour, line: { color: run.colour, width: 1 },
    })));
    const limits = PLOTS.flatMap(([name], row) => {
      const isNear = name === "speed_ratio" && this.curves(name).some((values) => values.some((v) => v > 0.6));
      return isNear ? [{ type: "line", xref: "paper", x0: 0, x1: 1, yref: yAxis(row), y0: 1, y1: 1,
        line: { color: css("soft"), width: 1, dash: "dot" } }] : [];
    });
    return {
      margin: { l: 52, r: 8, t: 16, b: 34 },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { size: 11, color: css("soft"), family: getComputedStyle(document.body).fontFamily },
      showlegend: false, dragmode: false, hovermode: "x", hoverdistance: 30,
      xaxis: { ...grid, anchor: `y${PLOTS.length}`, title: { text: "time [s]", standoff: 4, font: { size: 11 } }, fixedrange: true,
        range: [0, Math.max(...this.runs.map((run) => run.source.duration)) || 1] },
      ...Object.fromEntries(PLOTS.map(([name], row) => [yAxis(row).replace("y", "yaxis"), { ...grid, ...this.range(name, row) }])),
      annotations: PLOTS.map(([, text], row) => ({ text, xref: "paper", yref: "paper", x: 0, y: top(row),
        xanchor: "left", yanchor: "bottom", showarrow: false, font: { size: 11.5, color: css("ink") } })),
      shapes: [...stops, ...limits],
    };
  }

  /** Where a plot is, and what its axis goes over. @param {string} name @param {number} row */
  range(name, row) {
    const curves = this.curves(name);
    const range = name.endsWith("_error") ? logarithmic(curves) : null;
    return {
      domain: [top(row) - HEIGHT, top(row)], nticks: 4, fixedrange: true,
      tickformat: range || Math.max(...curves.map(largest)) < 1e-2 ? "~e" : "~g",
      ...(range ? { type: "log", range, dtick: Math.ceil((range[1] - range[0]) / 5) } : { rangemode: "tozero" }),
    };
  }

  /** Move the cursor. @param {number} t [s] */
  move(t) {
    this.time = t;
    const { xaxis: axis, yaxis: first, [`yaxis${PLOTS.length}`]: last } = this.figure._fullLayout ?? {};
    if (!axis) return;
    this.cursor.style.top = `${first._offset}px`;
    this.cursor.style.height = `${last._offset + last._length - first._offset}px`;
    this.cursor.style.transform = `translateX(${axis._offset + axis.l2p(t)}px)`;
  }
}

/** @param {number} row */
const top = (row) => 1 - row * (HEIGHT + GAP);

/** @param {number} row */
const yAxis = (row) => (row === 0 ? "y" : `y${row + 1}`);
