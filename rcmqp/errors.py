"""Every error that rcmqp raises on purpose.

Each says what was given, what is allowed and what to do, and carries the objects that a
program would want to look at.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Self

MOST_NAMES = 40
"""Names that a message lists."""


class RcmqpError(Exception):
    """Root of every error that rcmqp raises on purpose; it can be pickled."""

    def __reduce__(self) -> tuple[object, ...]:
        """Restore attributes in pickle, which would call the class with the message alone."""
        return _restored, (type(self), self.args), self.__dict__

    def of(self, file: str | os.PathLike[str]) -> Self:
        """The same error, with the file that it comes from before its message."""
        if str(file) not in str(self):
            self.args = (f"{file}: {self}",)
        return self


def _restored(kind: type[RcmqpError], arguments: tuple[object, ...]) -> RcmqpError:
    return kind.__new__(kind, *arguments)


FILES = {
    "arm": (".toml", ".urdf"),
    "controller": (".py",),
    "scenario": (".py", ".json", ".h5"),
}
"""How files end that may be given in place of a name."""


class UnknownName(RcmqpError, LookupError):
    """A name is not in its registry.

    Attributes:
        kind: what was looked for, such as ``"arm"``.
        name: the name given.
        known: every name that would have been accepted.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.kind, self.name, self.known = kind, name, sorted(known)
        close = difflib.get_close_matches(name, self.known, n=3, cutoff=0.5)
        hint = f"; did you mean {' or '.join(close)}?" if close else ""
        files = [f"{name}{end}" for end in FILES.get(kind, ()) if name.isidentifier()]
        if there := [file for file in files if os.path.isfile(file)]:
            hint = f"; there is a file {there[0]}: give that"
        end = "; or give the path of a URDF, with --flange FRAME" if kind == "arm" else ""
        super().__init__(f"unknown {kind} {name!r:.80}{hint} (known: {_some(self.known)}){end}")


def _some(names: list[str]) -> str:
    """The first MOST_NAMES of names, and how many more there are."""
    more = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


class PluginError(RcmqpError):
    """A name that another distribution adds by an entry point cannot be used.

    Attributes:
        group: of the entry point.
        name: what it is called.
        distribution: name and version of the distribution that adds it.
    """

    def __init__(self, group: str, name: str, distribution: str, reason: str) -> None:
        self.group, self.name, self.distribution = group, name, distribution
        super().__init__(f"{name!r} in {group}, of the distribution {distribution}: {reason}")


class ArmError(RcmqpError):
    """An arm's model cannot be read, or is not a fixed-base serial arm."""


class ArmWarning(UserWarning):
    """An arm was loaded, and something about it looks wrong."""


class FrameNotFound(ArmError):
    """A frame name is not in the model."""

    def __init__(self, name: str, frames: Iterable[str]) -> None:
        self.name, self.frames = name, list(frames)
        close = difflib.get_close_matches(name, self.frames, n=3)
        hint = f"did you mean {' or '.join(close)}? " if close else ""
        last = ", ".join(self.frames[-4:])
        super().__init__(f"no frame {name!r:.80} in the model; {hint}(the last ones are {last})")


class JointLimitViolated(RcmqpError):
    """A configuration lies outside the joint limits."""

    def __init__(
        self, joint: str, position: float, lower: float, upper: float, unit: str = "rad"
    ) -> None:
        self.joint, self.position, self.lower, self.upper = joint, position, lower, upper
        super().__init__(
            f"{joint} at {position:.4f} {unit}, allowed [{lower:.4f}, {upper:.4f}]; "
            "start from a configuration inside the limits"
        )


class InsertionError(RcmqpError):
    """Arm, instrument, trocar and starting configuration do not fit together."""


class TrocarOffShaft(InsertionError):
    """At the start the shaft does not pass through the trocar.

    Attributes:
        distance: from the trocar to the shaft's axis [m].
        tolerance: what was allowed [m].
    """

    def __init__(self, distance: float, tolerance: float) -> None:
        self.distance, self.tolerance = distance, tolerance
        super().__init__(
            f"the trocar is {1e3 * distance:.3f} mm off the shaft's axis at the start, allowed "
            f"{1e3 * tolerance:.3f} mm; move the trocar, allow the distance by the tolerance, or "
            "let find_start() choose the configuration (on the command line: --trocar without "
            "--tolerance)"
        )


class NoStartFound(InsertionError):
    """No configuration inside the limits puts the shaft through the given trocar."""


class CalibrationError(RcmqpError):
    """Recorded poses do not show where a pivot is."""


class InvalidCommand(RcmqpError, ValueError):
    """A view command, a pose or a joint vector is not finite or has the wrong size."""


class OptionError(RcmqpError, ValueError):
    """An option of a scenario, path or controller has a value that is not allowed."""


class RunFileError(RcmqpError):
    """A file is not a run that this version can read, or cannot be written."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path}: {reason}")


class ViewError(RcmqpError):
    """Runs cannot be shown together, or not on this machine."""


class ToolMissing(ViewError):
    """A program that pictures or video need is not installed.

    Attributes:
        tool: its name.
        remedy: what to install.
    """

    def __init__(self, tool: str, remedy: str) -> None:
        self.tool, self.remedy = tool, remedy
        super().__init__(f"{tool} is not installed, or not found: {remedy}")


class InvalidProblem(RcmqpError, ValueError):
    """A QP, level or set of bounds has a NaN, a wrong shape or an impossible bound."""


class WrongShape(InvalidProblem):
    """An array of a QP, level or set of bounds is not numbers, or has a wrong shape.

    This comes from a mistake in a program, not from the arm's state: no controller answers it
    with its safe stop.
    """


class SolverNotInstalled(RcmqpError, ImportError):
    """A solver is known by name, but its package is missing."""

    def __init__(self, solver: str, package: str) -> None:
        self.solver, self.package = solver, package
        super().__init__(f"solver {solver!r} is not installed; run: pip install {package}")
