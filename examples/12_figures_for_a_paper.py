"""Figures for a paper: one column wide, from recorded runs, in matplotlib.

A recorded run is one HDF5 file with every array, its unit and its meaning. So a figure can be
drawn at any time, as often as a reviewer asks, without a new simulation. The digest of a run says
whether two people have the same numbers.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

import rcmqp

COLUMN = 3.5
"""Width of a column in the journals of the IEEE [inch]."""

STYLE = {"font.size": 8, "axes.linewidth": 0.6, "lines.linewidth": 0.9, "pdf.fonttype": 42}
LAWS = {"paper's law": "dual_quaternion", "RCM as a task": "hierarchical_qp"}


def main(picture: str = "12_figures_for_a_paper.png", duration: float = 8.0) -> None:
    """Record two runs in a moving trocar for ``duration`` [s], load them and draw RCM errors."""
    scenario = rcmqp.load_scenario("breathing_trocar", arm="panda", duration=duration)
    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context(STYLE):
        for name in LAWS.values():
            controller = rcmqp.make_controller(name, scenario.insertion(), scenario.period)
            rcmqp.record(scenario, controller, Path(folder, f"{name}.h5"))

        figure = Figure(figsize=(COLUMN, 2.2), layout="constrained")
        axes = figure.subplots()
        for label, name in LAWS.items():
            run = rcmqp.Run.load(Path(folder, f"{name}.h5"))
            axes.semilogy(run.time, 1e3 * run.rcm_error.clip(1e-12), label=label)
            print(f"{name:16} {run.digest[:12]}")
        axes.set(xlabel="Time [s]", ylabel="RCM error [mm]", ylim=(1e-7, 10.0))
        axes.legend(frameon=False, ncols=2, loc="upper center")
        figure.savefig(Path(picture).with_suffix(".pdf"))
        figure.savefig(picture, dpi=200)


if __name__ == "__main__":
    main(*sys.argv[1:2])
