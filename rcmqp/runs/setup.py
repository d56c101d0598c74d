"""The settings of a run and of its controller, in words, and the command that makes it again."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from rcmqp.controllers import CONTROLLERS, controller_options
from rcmqp.controllers.given import NOT_SAID
from rcmqp.errors import PluginError, RcmqpError
from rcmqp.references.operators import STEERED
from rcmqp.references.paths import PATHS, Foreign
from rcmqp.references.paths.traces import TipTrace
from rcmqp.runs.head import Head
from rcmqp.runs.loop_record import PATH as REAL_TIME
from rcmqp.runs.loop_record import TIMES
from rcmqp.runs.run import Run
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.world.instrument import Camera, Instrument, Mount, Wrist
from rcmqp.world.motions import Sampled
from rcmqp.world.plugins import Registry, points

GIVEN = ("feed_forward", "roll", "limits_enforced", "period_ms", "gain", "assumed", "setup")
"""Measures of given_cells(), in the order of columns."""

TOLD = ("feed_forward", "gain", "velocity_limit", "velocity_limits", "objective")
"""Options that given_cells() already tells."""

DEFAULT = "default"
"""Stands in a table for a run that has nothing of the kind."""


def setup_text(head: Head) -> str:
    """Instrument, recorded path and motion, and null-space objective, where not the defaults."""
    scenario, parts = head.scenario, list[str]()
    if instrument := ", ".join(_instrument(scenario.instrument)):
        parts.append(f"instrument: {instrument}")
    if isinstance(path := scenario.path, TipTrace):
        parts.append(f"path: recorded, {len(path.times)} samples to {path.times[-1]:g} s")
    if isinstance(motion := scenario.motion, Sampled):
        parts.append(f"motion: recorded, {len(motion.times)} samples to {motion.times[-1]:g} s")
    if head.given.objective:
        parts.append(f"objective: {head.given.objective}")
    return "; ".join(parts) or DEFAULT


def _instrument(own: Instrument) -> Iterator[str]:
    """Describe where an instrument differs from Instrument()."""
    usual = Instrument()
    for name in ("length", "radius", "mount_offset"):
        if (value := getattr(own, name)) != getattr(usual, name):
            yield f"{name.replace('_', ' ')} {1e3 * value:g} mm"
    if own.mount != Mount():
        xyz = " ".join(f"{1e3 * x:g}" for x in own.mount.xyz)
        rpy = " ".join(f"{math.degrees(x):.4g}" for x in own.mount.rpy)
        yield f"mounted at {xyz} mm, turned by {rpy} deg"
    for name in ("field_of_view", "angle", "roll"):
        if (value := getattr(own.camera, name)) != getattr(Camera(), name):
            yield f"camera {name.replace('_', ' ')} {math.degrees(value):.4g} deg"
    if own.wrist is not None:
        yield _wrist(own.wrist)


def _wrist(wrist: Wrist) -> str:
    """How many joints, and which of their limits no source gives."""
    assumed = [
        name
        for name in ("acceleration", "jerk")
        if any(getattr(joint, name) is None for joint in wrist.joints)
    ]
    more = f" whose {' and '.join(assumed)} limits are assumed" if assumed else ""
    return f"wrist of {len(wrist.joints)} joints{more}"


def given_cells(head: Head) -> dict[str, str]:
    """The settings of a run and its controller as texts, by the names in GIVEN."""
    given = head.given
    return {
        "feed_forward": given.feed_forward_text,
        "roll": given.roll_text,
        "limits_enforced": given.limits_text,
        "period_ms": f"{1e3 * head.scenario.period:g}",
        "gain": given.gain_text,
        "assumed": " and ".join(head.assumed) or "none",
        "setup": setup_text(head),
    }


def given_names(cells: Iterable[Mapping[str, str]]) -> list[str]:
    """Names in GIVEN that a table shows; ``setup`` only if a run differs from the defaults."""
    set_up = any(each["setup"] not in ("", DEFAULT) for each in cells)
    return [name for name in GIVEN if name != "setup" or set_up]


def given_words(cells: Mapping[str, str]) -> dict[str, str]:
    """The texts of given_cells() with their labels, for a legend or a caption."""
    return {
        name: f"{of.label} = {cells[name]} {of.unit}"
        if of.unit and cells[name] != NOT_SAID
        else f"{of.label}: {cells[name]}"
        for name, of in ((name, MEASURES[name]) for name in given_names([cells]))
    }


def joint_units(head: Head) -> tuple[str, ...]:
    """Unit of each joint's position, rad or m; rad of an arm that this machine does not have."""
    try:
        units = head.scenario.load_arm().joint_units
    except RcmqpError:
        units = ()
    return units if len(units) == len(head.joints) else ("rad",) * len(head.joints)


def unit_of(units: Iterable[str]) -> str:
    """The unit of a number over several joints: each unit once, rad or m."""
    return " or ".join(dict.fromkeys(units)) or "rad"


def remark_of(law: str) -> str:
    """The remark of a controller's class; empty if this machine does not have it."""
    try:
        return CONTROLLERS[law].remark if law in CONTROLLERS else ""
    except PluginError:
        return ""


def run_command(run: Run, scenario: str, file: str) -> str:
    """The command that repeats a simulated run; a comment if no command can.

    Args:
        run: to be made again.
        scenario: JSON file of its scenario, whose period and seed may be others.
        file: to write the run to.
    """
    path = run.scenario.path
    asked = isinstance(path, Foreign) and path.kind == REAL_TIME
    if asked or run.diagnostics.keys() >= TIMES.keys():
        return f"# {file}: recorded in real time, so no command makes it again"
    kind, law = CONTROLLERS.get(run.controller), run.controller
    if kind is None or not _is_installed(kind, CONTROLLERS):
        if not (law := run.given.file):
            return f"# {file}: its controller {run.controller!r} is not one of rcmqp's"
    if isinstance(path, Foreign) or not _is_installed(type(path), PATHS, STEERED):
        name = path.kind if isinstance(path, Foreign) else type(path).__name__
        return f"# {file}: its path {name!r} is not one of rcmqp's"
    defaults = {} if kind is None else controller_options(run.controller)
    changed = {name: x for name, x in run.options.items() if x != defaults.get(name)}
    if any(not isinstance(value, bool | int | float | str) for value in changed.values()):
        given = " and ".join(map(repr, changed))
        return f"# {file}: made in Python, its {given} were given there"
    words = ["rcmqp", "run", scenario, "--controller", law]
    words += ["--period", repr(run.period), "--seed", str(run.scenario.seed)]
    for name, value in changed.items():
        words += ["--set", f"{name}={value}"]
    command = shlex.join([*words, "--out", file])
    needs = law.rpartition(":")[0]
    return f"# needs {shlex.quote(needs)} in this folder\n{command}" if needs else command


def _is_installed(kind: type, *registries: Registry[Any]) -> bool:
    """Whether any process finds the class: it is of rcmqp, or a plug-in's."""
    return kind.__module__.startswith("rcmqp.") or any(
        registry.name_of(kind) in points(registry.group) for registry in registries
    )
