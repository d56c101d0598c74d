// The legend: a row a run, with its errors now; and marks for all that the scene shows.

import { mark, query } from "./elements.js";
import { depth, millimetres } from "./format.js";

/** @typedef {import("./recording.js").Recorded} Recorded */
/** @typedef {import("./recording.js").Surroundings} Surroundings */
/** @typedef {import("./sources.js").State} State */

export class Legend {
  /**
   * @param {Recorded[]} runs
   * @param {(run: number) => void} choose is called with the run whose row is clicked on
   */
  constructor(runs, choose) {
    const body = /** @type {HTMLTableSectionElement} */ (query(document, "#legend tbody"));
    this.rows = runs.map((run, i) => {
      const row = body.insertRow();
      const cells = [0, 1, 2, 3].map(() => row.insertCell());
      const button = document.createElement("button");
      button.append(mark(`run ${run.dash}`, run.label, { color: run.colour }));
      button.title = "the arm of this run is solid, and the endoscope is its own";
      cells[0].append(button);
      row.addEventListener("click", () => choose(i));
      query(document, "#caption").append(mark("solid", run.label, { color: run.colour }));
      return { row, button, cells };
    });
  }

  /** Mark the row of the main run. @param {number} main */
  choose(main) {
    this.rows.forEach(({ row, button }, i) => {
      row.classList.toggle("main", i === main);
      button.setAttribute("aria-pressed", String(i === main));
    });
  }

  /** Write the errors and the depth of each run. @param {State[]} states */
  write(states) {
    states.forEach((state, i) => {
      const [, tip, rcm, deep] = this.rows[i].cells;
      tip.textContent = millimetres(state.tip_error[0]);
      rcm.textContent = millimetres(Math.hypot(...Array.from(state.slip)));
      deep.textContent = depth(state.depth[0]);
    });
  }
}

/**
 * Marks of what the scene has, in the legend and in the caption of a picture.
 *
 * @param {Surroundings} scene
 * @param {boolean} hasStops whether a safe stop is drawn
 */
export function addMarks({ targets, spheres, obstacles }, hasStops) {
  const pie = spheres.map(({ colour }) => `rgb(${colour.map((x) => 255 * x)})`);
  const there = {
    "desired tip": true, target: targets.length > 0, sphere: spheres.length > 0,
    obstacle: obstacles.length > 0, "cone of the shaft": true, "depths of the tip": true, "safe stop": hasStops,
  };
  const [caption, keys] = [query(document, "#caption"), query(document, "#keys")];
  for (const [name, isThere] of Object.entries(there)) {
    if (!isThere) continue;
    const style = name === "sphere" ? { background: `conic-gradient(${pie})` } : {};
    caption.append(mark(name.split(" ")[0], name, style));
    keys.insertBefore(mark(name.split(" ")[0], name, style), keys.querySelector("br"));
  }
}
