// Errors, joint speed and singular value over time, with a cursor, by plotly.

const PLOTS = [
  ["tip_error", "tip error [mm]"],
  ["rcm_error", "RCM error [mm]"],
  ["speed_ratio", "joint speed / limit"],
  ["singular_value", "least singular value"],
];
const DASHES = { solid: "solid", dashed: "dash", dashdot: "dashdot", dotted: "dot" }; // as plotly calls them
const FAR_APART = 30; // ratio of the runs' maxima above which an error is drawn logarithmically

// What a hundredth of the values, not counting missing ones, lies below.
function hundredth(values) {
  const sorted = values.filter((value) => !Number.isNaN(value)).sort();
  return sorted[Math.floor(0.01 * sorted.length)];
}

class Plots {
  constructor(pane, runs, seek) {
    Object.assign(this, { pane, runs });
    this.figure = pane.querySelector("#figure");
    this.cursor = pane.querySelector("#cursor");
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

  // The largest value of each run.
  maxima(name) {
    return this.runs.map((run) => run.curves[name][1].reduce((a, b) => (b > a ? b : a), 0)); // NaN is not
  }

  // Maxima that lie far apart need a logarithmic axis, or the small ones are a line at zero: its
  // range in powers of ten, or false. It starts below all but the lowest hundredth of each run,
  // as the figures do, but no more than three decades below the least maximum.
  logarithmic(name) {
    const most = this.maxima(name);
    const [least, greatest] = [Math.min(...most), Math.max(...most)];
    const apart = name.endsWith("_error") && least > 0 && greatest > FAR_APART * least;
    const low = Math.min(...this.runs.map((run) => hundredth(run.curves[name][1])));
    return apart && [Math.log10(Math.max(0.5 * low, 1e-3 * least)), Math.log10(greatest) + 0.3];
  }

  draw(main) {
    const style = getComputedStyle(document.body);
    const grid = { gridcolor: css("line"), linecolor: css("soft"), zeroline: false, automargin: false };
    const gap = 0.085;
    const height = (1 - gap * (PLOTS.length - 1)) / PLOTS.length;
    const layout = {
      margin: { l: 52, r: 8, t: 16, b: 34 },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { size: 11, color: css("soft"), family: style.fontFamily },
      showlegend: false, dragmode: false, hovermode: "x", hoverdistance: 30,
      xaxis: { ...grid, anchor: `y${PLOTS.length}`, title: { text: "time [s]", standoff: 4, font: { size: 11 } }, fixedrange: true,
        range: [0, Math.max(...this.runs.map((run) => run.frames.time.at(-1))) || 1] },
      annotations: [],
      shapes: this.runs.flatMap((run) => run.stops.map(([x0, x1]) => ({ // where it stopped safely
        type: "rect", x0, x1, yref: "paper", y0: 0, y1: 1, layer: "below", opacity: 0.18,
        fillcolor: run.colour, line: { color: run.colour, width: 1 },
      }))),
    };
    const traces = [];
    PLOTS.forEach(([name, title], row) => {
      const y = row === 0 ? "y" : `y${row + 1}`;
      const top = 1 - row * (height + gap);
      const log = this.logarithmic(name);
      layout[y.replace("y", "yaxis")] = {
        ...grid, domain: [top - height, top], nticks: 4, fixedrange: true,
        tickformat: log || Math.max(...this.maxima(name)) < 1e-2 ? "~e" : "~g",
        ...(log ? { type: "log", range: log, dtick: Math.ceil((log[1] - log[0]) / 5) } : { rangemode: "tozero" }),
      };
      layout.annotations.push({ text: title, xref: "paper", yref: "paper", x: 0, y: top, xanchor: "left",
        yanchor: "bottom", showarrow: false, font: { size: 11.5, color: css("ink") } });
      if (name === "speed_ratio" && this.runs.some((run) => run.curves[name][1].some((v) => v > 0.6)))
        layout.shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: y, y0: 1, y1: 1,
          line: { color: css("soft"), width: 1, dash: "dot" } });
      this.runs.forEach((run, i) => {
        const [x, values] = run.curves[name];
        traces.push({ x, y: values, yaxis: y, type: "scatter", mode: x.length > 1 ? "lines" : "markers", name: run.label,
          line: { color: run.colour, width: i === main ? 1.8 : 1.3, dash: DASHES[run.dash] },
          hovertemplate: "%{y:.4~g}<extra></extra>" });
      });
    });
    return Plotly.react(this.figure, traces, layout, { displayModeBar: false, responsive: true })
      .then(() => {
        this.watched ??= this.figure.on("plotly_afterplot", () => this.move(this.time)); // resized
        this.move(this.time ?? 0);
      });
  }

  move(t) {
    this.time = t;
    const { xaxis: axis, yaxis: first, [`yaxis${PLOTS.length}`]: last } = this.figure._fullLayout ?? {};
    if (!axis) return;
    this.cursor.style.top = `${first._offset}px`;
    this.cursor.style.height = `${last._offset + last._length - first._offset}px`;
    this.cursor.style.transform = `translateX(${axis._offset + axis.l2p(t)}px)`;
  }
}
