"""rcmqp new: files of one's own to begin with, which run as they stand."""

from __future__ import annotations

import json
import keyword
import re
import sys
import tomllib
from collections.abc import Sequence
from enum import StrEnum
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Annotated

import typer

from rcmqp.cli import console
from rcmqp.controllers import CONTROLLERS
from rcmqp.errors import OptionError, RcmqpError, UnknownName
from rcmqp.files import check_writable, write_text
from rcmqp.runs.loading import scenario_names
from rcmqp.world.loading import arm_names, load_arm

LAW = '''"""A controller of one's own; run it with

    rcmqp run conical_helix -c {name}.py
    rcmqp compare -s conical_helix -c {name}.py -c dual_quaternion
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rcmqp.controllers import Command, Controller
from rcmqp.controllers.checks import bounded_gain
from rcmqp.maths.options import positive
from rcmqp.references.view import Reference
from rcmqp.tasks import RcmTask, RollTask, TipTask
from rcmqp.world.arm import ArmState


@dataclass(frozen=True, eq=False)
class {title}(Controller):
    """Trocar, tip and roll in one damped least-squares problem: no priorities, no limits.

    Attributes:
        gain: K, how fast an error decays [1/s].
        damping: of the joints' speed; near a singularity it keeps v small.
    """

    enforces = ()  # no joint limits; tables say this, and the two below
    feed_forward = True
    holds_roll = True

    gain: float = field(default=60.0, metadata=bounded_gain())
    damping: float = field(default=1e-3, metadata=positive())

    def _step(self, state: ArmState, reference: Reference) -> Command:
        tasks = RcmTask(period=self.period), TipTask(), RollTask()
        found = [task.evaluate(state, reference) for task in tasks]
        J = np.vstack([each.jacobian for each in found])
        rate = np.concatenate([-self.gain * each.error - each.drift for each in found])
        return Command(J.T @ np.linalg.solve(J @ J.T + self.damping**2 * np.eye(len(J)), rate))
'''

SCENARIO = '''"""A scenario of one's own; run it with

    rcmqp run {name}.py
    rcmqp compare -s {name}.py
"""

from __future__ import annotations

from rcmqp import Scenario
from rcmqp.references.paths import Lissajous


def scenario(arm: str = "panda", *, flange: str | None = None) -> Scenario:
    """A Lissajous figure from the arm's home, the tip 12 cm inside, at 1 kHz."""
    path = Lissajous()
    return Scenario.on_shaft("{name}", arm, path, flange=flange, depth=0.12, period=1e-3)


if __name__ == "__main__":
    from rcmqp.cli import run_file

    run_file(__file__)
'''

ARM = """# An arm of one's own: what rcmqp knows of it beside its URDF, {name}.urdf. SI units, rad.
#     rcmqp arms {name}.toml
#     rcmqp run conical_helix --arm {name}.toml
title = "{title}"
urdf = "{name}.urdf"
# home = [0.0, 0.5, 0.0, 1.2, 0.0, 1.4, 0.0]   # without it, one is searched

# Limits of your arm's data sheet; a URDF seldom has these, and rcmqp assumes careful ones.
# acceleration = [10.0, 10.0, 10.0, 10.0, 15.0, 15.0, 20.0]   # rad/s^2
# jerk = 500.0                                                # rad/s^3

[flange]
frame = "flange"          # where the instrument is mounted; its z axis points outwards
# xyz = [0.0, 0.0, 0.0]   # of the mount in that frame
# rpy = [0.0, 0.0, 0.0]

[base]                    # where the URDF's base stands in the world
# xyz = [0.0, 0.0, 0.8]

[sources]                 # of the numbers above
# acceleration = "data sheet, page 12"
"""

LENGTHS = (0.16, 0.18, 0.2, 0.2, 0.2, 0.19, 0.08)
"""Of the template's links, from the base [m]."""


class Kind(StrEnum):
    """The kinds of file that ``rcmqp new`` writes."""

    law = "law"
    scenario = "scenario"
    arm = "arm"


KINDS = {**{kind.value: kind for kind in Kind}, "controller": Kind.law}
"""The words for a kind on the command line; a controller is a law."""


def new(
    kind: Annotated[
        str,
        typer.Argument(
            help="law (or controller, which is the same), scenario or arm.",
            autocompletion=lambda: [*KINDS],
        ),
    ],
    name: Annotated[str, typer.Argument(help="Of the files to write, such as my_law.")],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="What an arm's file is to say, in place of a template, such as like=ur5; may be "
            "repeated.",
        ),
    ] = None,
) -> None:
    """Write a file of your own to begin with: a controller, a scenario, or an arm.

    For example,

      rcmqp new law my_law

      rcmqp run conical_helix -c my_law.py

      rcmqp new arm my_robot

      rcmqp new arm ceiling --set like=lwa3 --set 'base.xyz=[0,0,2]' --set 'base.rpy=[3.1416,0,0]'
    """
    if kind not in KINDS:
        raise UnknownName("kind of file", kind, KINDS)
    _write(KINDS[kind], name, settings or [])


def _write(kind: Kind, name: str, settings: Sequence[str]) -> None:
    """Write the files of one kind.

    Raises:
        RcmqpError: the name or a setting is not allowed, or a file is there already.
    """
    title = "".join(word.capitalize() for word in name.split("_"))
    if not name.isidentifier() or keyword.iskeyword(name) or not title.isidentifier():
        raise OptionError(f"{name}: letters, digits and underscores, such as my_{kind.value}")
    if taken := _taken(kind, name, title):
        raise OptionError(f"{name} is {taken}; give another name, such as my_{name}")
    if settings and kind is not Kind.arm:
        raise OptionError(f"--set is of an arm's file; a {kind.value} is changed in its own file")
    texts = {
        Kind.law: {f"{name}.py": LAW},
        Kind.scenario: {f"{name}.py": SCENARIO},
        Kind.arm: {f"{name}.toml": ARM, f"{name}.urdf": _urdf()},
    }[kind]
    if settings:
        texts = {f"{name}.toml": _arm_file(settings)}
    for file in texts:
        if Path(file).exists():
            raise OptionError(f"{file} is there already; give another name, or remove it first")
        check_writable(file)
    for file, text in texts.items():
        write_text(file, text.replace("{name}", name).replace("{title}", title))
        if settings:
            _check_arm(Path(file))
        console.print_written(Path(file))


def _taken(kind: Kind, name: str, title: str) -> str:
    """What has the name already, where a file of that name would hide it; else nothing."""
    if kind is Kind.law and name in CONTROLLERS:
        return "a controller that is there already"
    if kind is Kind.scenario and name in scenario_names():
        return "a scenario that is there already"
    if kind is Kind.arm and name in arm_names():
        return "an arm that is there already"
    if kind is Kind.law and re.search(rf"\b{title}\b", LAW):
        return f"a name that the file needs for itself, {title}"
    if kind is Kind.arm:
        return ""
    here = [str(Path.cwd()), ""]
    elsewhere = [folder for folder in sys.path if folder not in here]
    if name in sys.builtin_module_names or PathFinder.find_spec(name, elsewhere):
        return "a Python module, which a file of that name would hide from Python"
    return ""


def _arm_file(settings: Sequence[str]) -> str:
    """An arm's file that says what was set: ``key=value`` and ``table.key=value``, as in TOML.

    Raises:
        OptionError: a setting has no value, or is there twice.
    """
    tables: dict[str, dict[str, str]] = {"": {}}
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        table, _, inside = key.rpartition(".")
        if not (equals and value and inside):
            raise OptionError(f"--set {setting}: give a key and a value, such as like=ur5")
        entries = tables.setdefault(table, {})
        if inside in entries:
            raise OptionError(f"--set {key} is there twice; give it once")
        try:
            tomllib.loads(f"value = {value}")
        except tomllib.TOMLDecodeError:  # a text without quotes
            value = json.dumps(value)
        entries[inside] = value
    lines = []
    for table, entries in tables.items():
        lines += [f"[{table}]"] if table else []
        lines += [f"{key} = {value}" for key, value in entries.items()]
    return "\n".join([*lines, ""])


def _check_arm(file: Path) -> None:
    """Load the arm that was written; remove the file if that fails.

    Raises:
        RcmqpError: it cannot be loaded.
    """
    try:
        load_arm(file)
    except RcmqpError:
        file.unlink()
        raise


def _urdf() -> str:
    """A URDF of seven joints about z and y in turns, to be replaced by the arm's own."""
    lines = ['<robot name="{name}">', '  <link name="base"/>']
    for i, before in enumerate((0.0, *LENGTHS[:-1]), 1):
        axis = "0 0 1" if i % 2 else "0 1 0"
        lines += [
            f'  <joint name="joint{i}" type="revolute">',
            f'    <parent link="{f"link{i - 1}" if i > 1 else "base"}"/> <child link="link{i}"/>',
            f'    <origin xyz="0 0 {before}"/> <axis xyz="{axis}"/>',
            '    <limit lower="-2.6" upper="2.6" velocity="2.0" effort="100"/>',
            "  </joint>",
            f'  <link name="link{i}"/>',
        ]
    return "\n".join(
        [
            *lines,
            '  <joint name="mount" type="fixed">',
            f'    <parent link="link{len(LENGTHS)}"/> <child link="flange"/>',
            f'    <origin xyz="0 0 {LENGTHS[-1]}"/>',
            "  </joint>",
            '  <link name="flange"/>',
            "</robot>",
            "",
        ]
    )
