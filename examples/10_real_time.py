"""In real time: the loop drives a simulated arm in another process, over UDP.

The loop runs at 1 kHz on absolute deadlines and always ends at rest. Its report says how late
cycles began and answered, and where every command went. On a desktop without real-time priority
some cycles are late; the arm then keeps its last velocity for a moment, or stops by itself.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

from rcmqp.realtime.latency import EDGES
from rcmqp.realtime.loopback import run_loopback


def main(picture: str = "10_real_time.png", duration: float = 10.0) -> None:
    """Drive circles for ``duration`` [s], print the account, and draw the delays."""
    report = run_loopback(duration, arm="panda", controller="hierarchical_qp")
    loop = report.loop
    print(f"{loop.cycles} cycles, {loop.missed} deadlines missed; {loop.stop.fault or 'no fault'}")
    print(f"{report.sent} commands sent, {report.arm.used} used, {report.unaccounted} unaccounted")
    print(f"RCM error of the arm {report.arm.rcm_max_mm:.4f} mm at most")

    figure = Figure(figsize=(7.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for name, delays in {"began": loop.wake, "answered": loop.answer}.items():
        later = 1.0 - np.cumsum(delays.counts[:-1]) / delays.total
        axes.loglog(1e3 * np.array(EDGES), later, drawstyle="steps-post", label=name)
    axes.axvline(1e3 * loop.period, color="black", linewidth=0.8)
    axes.set(xlabel="delay after the cycle was due [ms]", ylabel="share of cycles that are later")
    axes.set(xlim=(1e-3, 1e2), ylim=(1e-4, 1.2))
    axes.legend()
    figure.savefig(picture, dpi=100)


if __name__ == "__main__":
    main(*sys.argv[1:2])
