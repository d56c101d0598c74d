"""rcmqp itself, by the calls that the README writes for a real arm."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from loop import Array, Cycle, Work, serve

import rcmqp
from rcmqp.controllers import CONTROLLERS, Controller, HierarchicalQP, controller_options
from rcmqp.limits import JointLimits
from rcmqp.qp import hierarchy_backends
from rcmqp.tasks import PoseTask, PostureTask, RcmTask, Task, TipTask

POSE = ("dual_quaternion", "pose_error", "damped")
"""Controllers that bring the effector to a pose; the others hold the RCM as a task."""

Make = Callable[[rcmqp.Insertion, float], Controller]


def cases() -> dict[str, Callable[[Work], Cycle]]:
    """Every controller with every backend, and the tasks that the other packages are given.

    A name without a backend runs on the controller's default one.
    """
    return {name: partial(_cycle, make) for name, make in (*_controllers(), *_others())}


def _controllers() -> Iterator[tuple[str, Make]]:
    for name in CONTROLLERS:
        options = controller_options(name)
        task = "pose" if name in POSE else "rcm"
        make = partial(rcmqp.make_controller, name)
        chooses = next((option for option in ("backend", "solver") if option in options), None)
        if chooses is None:
            yield f"{task}/{name}", make
            continue
        for backend in hierarchy_backends():
            label = f"{name}{'' if backend == options[chooses] else f', {backend}'}"
            yield f"{task}/{label}", partial(make, **{chooses: backend})


def _others() -> Iterator[tuple[str, Make]]:
    yield (
        "pose/dual_quaternion, feed_forward",
        partial(rcmqp.make_controller, "dual_quaternion", feed_forward=True),
    )
    default = controller_options("hierarchical_qp")["backend"]
    for backend in hierarchy_backends():
        label = "" if backend == default else f", {backend}"
        yield f"rcm/RCM > tip > posture{label}", partial(_hierarchy, _rcm, backend)
        yield f"pose/pose > posture{label}", partial(_hierarchy, _pose, backend)


def _hierarchy(
    levels: Callable[[rcmqp.Insertion], list[Task]],
    backend: str,
    insertion: rcmqp.Insertion,
    period: float,
) -> Controller:
    """Position, speed and acceleration limits, then the levels, each strictly above the next."""
    limits = [JointLimits(insertion.arm, period)]
    return HierarchicalQP(
        insertion, period, levels=levels(insertion), limits=limits, backend=backend
    )


def _rcm(insertion: rcmqp.Insertion) -> list[Task]:
    return [RcmTask(), TipTask(), PostureTask.made_for(insertion)]


def _pose(insertion: rcmqp.Insertion) -> list[Task]:
    return [PoseTask(), PostureTask.made_for(insertion)]


def _cycle(make: Make, work: Work) -> Cycle:
    """What is timed."""
    insertion = rcmqp.Insertion.on_shaft(
        rcmqp.load_arm("panda"), rcmqp.Instrument(), depth=work.depth
    )
    T = work.period
    controller = make(insertion, T)
    views = [rcmqp.ViewCommand(*view) for view in work.views.tolist()]
    q, v = insertion.q_start, insertion.q_start * 0.0

    def cycle(k: int) -> Array:
        nonlocal q, v
        state = insertion.state(q, v)
        reference = rcmqp.view_pose(insertion.x_rcm, views[k])
        v = controller.step(state, reference).v
        q = insertion.arm.integrate(q, v, T)
        return q

    return cycle


if __name__ == "__main__":
    serve(cases(), ["rcmqp", "pin", "numpy", "proxsuite", "daqp"])
