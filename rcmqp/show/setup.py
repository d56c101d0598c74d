"""What a run was set up with that the names of its scenario and controller do not tell."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rcmqp.references.paths.traces import TipTrace
from rcmqp.runs.head import Head
from rcmqp.world.instrument import Camera, Instrument, Mount, Wrist
from rcmqp.world.motions import Sampled

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
    """What is other than Instrument() has it."""
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
