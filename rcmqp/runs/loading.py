"""Scenarios by name, and from files."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from rcmqp.errors import OptionError, RcmqpError, UnknownName
from rcmqp.files import absent, why
from rcmqp.references.governor import Governor
from rcmqp.references.operators import STEERED
from rcmqp.references.paths import PATHS, Foreign
from rcmqp.runs.head import Head, opened
from rcmqp.runs.moved import at_port, with_instrument
from rcmqp.runs.scenario import DEFAULT_ARM, Scenario
from rcmqp.runs.untrusted import MOST_TEXT
from rcmqp.world.arm_limits import ArmLimits
from rcmqp.world.instrument import Instrument
from rcmqp.world.loading import arm_names
from rcmqp.world.plugins import cannot_run, distribution, load, module_of_file, points
from rcmqp.world.port import Port

RUN_FILE = ".h5"
"""How the name of a run's file ends."""

GROUP = "rcmqp.scenarios"
"""Of the entry points whose modules are scenarios."""


def scenario_names() -> list[str]:
    """Names that load_scenario() knows, sorted; those of plug-ins are among them."""
    return sorted(_own_names() | points(GROUP).keys())


def _own_names() -> set[str]:
    package = importlib.import_module("rcmqp.scenarios")
    return {module.name for module in pkgutil.iter_modules(package.__path__)}


def load_scenario(
    name: str,
    arm: str | None = None,
    *,
    flange: str | None = None,
    acceleration: float | Sequence[float | None] | None = None,
    jerk: float | Sequence[float | None] | None = None,
    instrument: Instrument | None = None,
    port: Port | None = None,
    **changes: Any,
) -> Scenario:
    """Make a scenario by name on an arm, or read one from a file.

    Args:
        name: a name out of scenario_names(), hyphens as good as underscores; or a .py file like
            those in the scenarios folder; or a .json file that holds Scenario.to_json(); or the
            .h5 file of a run, whose scenario and arm it is.
        arm: a name that load_arm() knows, or the path of an arm's file or of a URDF; without it,
            the scenario's own. A .json or .h5 file has its arm already.
        flange: with a URDF, the frame that carries the instrument.
        acceleration: limits of the joints in place of the arm's own, one number for all joints or
            one for each [rad/s^2].
        jerk: likewise [rad/s^3]; other limits are given by ``limits``.
        instrument: in place of the scenario's own; the incision is put on its shaft.
        port: where the incision is, in place of the scenario's own.
        changes: fields of Scenario to be other than the scenario has them, such as ``period``.

    Raises:
        UnknownName: there is no such scenario or field.
        OptionError: the file is not a scenario, or a value is not allowed.
        RcmqpError: the arm cannot be loaded.
    """
    if name.endswith((".json", RUN_FILE)):
        scenario = _read(Path(name))
        if arm is not None or flange is not None:
            raise OptionError(
                f"{name} has its own arm, {scenario.arm}; leave arm and flange out (--arm, "
                "--flange)"
            )
    else:
        if arm is not None and arm not in arm_names() and Path(arm).is_file():
            arm = str(Path(arm).resolve())
        module = scenario_module(name)
        try:
            scenario = module.scenario(arm or _default_arm(module), flange=flange)
        except RcmqpError:
            raise
        except Exception as error:
            raise OptionError(cannot_run(name, error, module.__file__)) from error
        if not isinstance(scenario, Scenario):
            raise OptionError(
                f"{name}: scenario() returned {type(scenario).__name__}, it must be a Scenario"
            )
    return changed(
        scenario, acceleration=acceleration, jerk=jerk, instrument=instrument, port=port, **changes
    )


def changed(
    scenario: Scenario,
    *,
    acceleration: float | Sequence[float | None] | None = None,
    jerk: float | Sequence[float | None] | None = None,
    instrument: Instrument | None = None,
    port: Port | None = None,
    **changes: Any,
) -> Scenario:
    """A scenario with other joint limits, instrument, incision and fields; see load_scenario().

    Raises:
        UnknownName: there is no such field.
        OptionError: a value is not allowed.
    """
    fields = [field.name for field in dataclasses.fields(Scenario)]
    for change in changes:
        if change not in fields:
            raise UnknownName("field of a scenario", change, fields)
    scenario = dataclasses.replace(scenario, **changes)
    given: dict[str, Any] = {"acceleration": acceleration, "jerk": jerk}
    given = {limit: value for limit, value in given.items() if value is not None}
    if given:
        limits = dataclasses.replace(scenario.limits or ArmLimits(), **given)
        scenario = dataclasses.replace(scenario, limits=limits)
    if instrument is not None:
        scenario = with_instrument(scenario, instrument)
    return scenario if port is None else at_port(scenario, port)


def scenario_changes(governor: bool | None, **changes: Any) -> dict[str, Any]:
    """Collect the changes of a scenario for changed() that were given; None means no change.

    Args:
        governor: whether there is to be one.
        changes: fields of Scenario.

    Raises:
        OptionError: the period is so long that it must be in ms.
    """
    given = {name: value for name, value in changes.items() if value is not None}
    if (period := given.get("period", 0.0)) >= 0.5:
        raise OptionError(
            f"period = {period:g} (--period) is in s; {period:g} ms are {1e-3 * period:g}"
        )
    return given if governor is None else given | {"governor": Governor() if governor else None}


def scenario_module(name: str) -> ModuleType:
    """The module of a scenario: one of scenario_names(), or a .py file like those.

    Raises:
        UnknownName: there is no such scenario.
        OptionError: the file is not there, or has no function ``scenario``.
        PluginError: the plug-in that has the scenario cannot be used.
    """
    if name.endswith(".py"):
        return _checked(name, module_of_file(name))
    name = name.replace("-", "_")
    if name in _own_names():
        return importlib.import_module(f"rcmqp.scenarios.{name}")
    if name not in points(GROUP):
        raise UnknownName("scenario", name, scenario_names())
    module: ModuleType = load(GROUP, name)
    return _checked(f"{name} of {distribution(GROUP, name)}", module)


def _checked(name: str, module: ModuleType) -> ModuleType:
    """The module, whose function ``scenario`` can be called as those of rcmqp are."""
    try:
        inspect.signature(module.scenario).bind("an arm", flange=None)
    except (AttributeError, TypeError, ValueError) as error:
        raise OptionError(
            f"{name} has no function scenario(arm, *, flange=None), or its scenario() takes other "
            "arguments"
        ) from error
    return module


def own_arm(name: str) -> str:
    """The arm of a scenario if none is given.

    Raises:
        RcmqpError: there is no such scenario.
    """
    if name.endswith((".json", RUN_FILE)):
        return _read(Path(name)).arm
    return _default_arm(scenario_module(name))


def _default_arm(module: ModuleType) -> str:
    """The default of the first argument of a scenario's function, or DEFAULT_ARM."""
    default = next(iter(inspect.signature(module.scenario).parameters.values())).default
    return DEFAULT_ARM if default is inspect.Parameter.empty else str(default)


def _read(file: Path) -> Scenario:
    if file.suffix == RUN_FILE:
        with opened(file) as run:
            return _known(Head.read(run).scenario)
    try:
        if not file.is_file():
            raise OptionError(f"{absent(file)}; give the path of a scenario's .json")
        if (size := file.stat().st_size) > MOST_TEXT:
            raise OptionError(f"it has {size} bytes, a scenario {MOST_TEXT} at most")
        return _known(Scenario.from_json(file.read_text(encoding="utf-8")))
    except OSError as error:
        raise OptionError(f"cannot read the scenario {file}: {why(error)}") from error
    except UnknownName:
        raise
    except (UnicodeDecodeError, RcmqpError) as error:
        raise OptionError(f"cannot read the scenario {file}: {error}") from error


def _known(scenario: Scenario) -> Scenario:
    """A scenario out of a file, whose path can be run here."""
    if isinstance(scenario.path, Foreign):
        raise UnknownName("path", scenario.path.kind, (*PATHS, *STEERED))
    return scenario
