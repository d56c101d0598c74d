"""The design of a study with people: what they do, with which controllers, in which order."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from rcmqp.controllers.settings import FILE_SETTING, controller_of, registered
from rcmqp.errors import OptionError, RcmqpError
from rcmqp.experiments.study.plan import Law
from rcmqp.experiments.trial.task import with_task
from rcmqp.files import write_text
from rcmqp.maths.options import at_least, options, positive
from rcmqp.references.paths import Search
from rcmqp.runs.loading import load_scenario
from rcmqp.runs.scenario import Scenario

FILE = "study.json"
"""The design's file, in the folder of the study."""

MOST_TEXT = 20_000
"""Letters of the text of consent."""


def orders(count: int) -> list[tuple[int, ...]]:
    """Rows of a Latin square of ``count`` conditions, balanced for what precedes what (Williams).

    Each condition is equally often at each place, and each follows each other one equally often.
    With an odd number of conditions this takes two squares.
    """
    first = [0]
    for k in range(1, count):
        first.append((k + 1) // 2 if k % 2 else count - k // 2)
    square = [tuple((each + row) % count for each in first) for row in range(count)]
    return square + [row[::-1] for row in square] if count > 1 and count % 2 else square


def scenario_sha256(scenario: str, arm: str) -> str:
    """SHA-256 of a scenario as JSON.

    Args:
        scenario: name or file.
        arm: name, or path of a URDF; empty for the scenario's own.
    """
    made = load_scenario(scenario, arm or None).to_json()
    return hashlib.sha256(made.encode()).hexdigest()


def file_sha256(setting: str) -> str:
    """SHA-256 of the file of a controller's setting, FILE.py or FILE.py:CLASS.

    Raises:
        OptionError: it cannot be read.
    """
    found = FILE_SETTING.fullmatch(setting)
    file = Path(found["file"] if found else setting)
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise OptionError(f"the controller {setting} cannot be read: {error}") from error


@options
@dataclass(frozen=True, slots=True)
class Design:
    """What every participant of a study does.

    Attributes:
        scenario: name or file.
        arm: name, or path of a URDF; empty for the scenario's own.
        laws: controllers, each a trial; their order differs from participant to participant.
        task: what is to be found.
        practice: how long novices practise [s]; 0 for not at all.
        scale: tip over hand.
        viscosity: of the device [N s/m].
        consent: text that a participant agrees to; empty for none.
        scenario_sha256: see scenario_sha256(); empty if it is not to be checked.
        own_laws: controllers in a file of one's own: the setting, FILE.py or FILE.py:CLASS, and
            the file's SHA-256, by the controller's name. What the file imports is not checked.
    """

    scenario: str
    arm: str
    laws: tuple[Law, ...]
    task: Search
    practice: float = field(default=120.0, metadata=at_least(0.0, "s"))
    scale: float = field(default=1.0, metadata=positive())
    viscosity: float = field(default=15.0, metadata=at_least(0.0, "N s/m"))
    consent: str = ""
    scenario_sha256: str = ""
    own_laws: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check that conditions differ and that the text of consent is one that can be read."""
        if not self.laws or len(set(self.laws)) < len(self.laws):
            raise OptionError("the controllers of a study must be at least one, each given once")
        if len(self.consent) > MOST_TEXT:
            raise OptionError(f"the text of consent must have at most {MOST_TEXT} letters")

    def made(self, law: Law) -> Scenario:
        """The scenario with the task, at the period of a controller.

        Raises:
            OptionError: the scenario, or a controller's file, is not what it was when the study
                began.
        """
        self.check_unchanged()
        base = load_scenario(self.scenario, self.arm or None, period=law.period)
        return with_task(base, self.task)

    def setting(self, law: Law) -> str:
        """A controller as another process finds it: its name, or the file that has it."""
        return self.own_laws[law.name][0] if law.name in self.own_laws else law.name

    def with_files(self, scenario: str | None, controllers: Sequence[str]) -> Self:
        """The design with the Python files that the experimenter gave, which are run.

        The folder of a study may come from anybody. So a file that it names is never run; the
        same file has to be given again. It may be in another place.

        Args:
            scenario: file of the scenario; None if the study's is not a Python file.
            controllers: FILE.py[:CLASS], a setting for each controller of one's own.

        Raises:
            OptionError: a file is missing, or is not that of the study.
            UnknownName: a controller of the study is not known here.
        """
        design = self
        if self.scenario.endswith(".py"):
            if scenario is None:
                raise OptionError(
                    f"the scenario of this study is a program, {self.scenario}; a file that a "
                    f"folder names is not run: give it again, rcmqp trial {self.scenario} --out "
                    "FOLDER. rcmqp study sums up such a study without --operators and --hand"
                )
            design = dataclasses.replace(self, scenario=scenario)
        self.check_files(controllers)
        given = {}
        for setting in controllers:
            name, options = controller_of(registered(setting))
            laws = [law for law in self.laws if law.name == name]
            other = options and tuple(options.items()) not in [law.options for law in laws]
            if not laws or other:
                known = "; ".join(map(str, self.laws))
                raise OptionError(
                    f"{setting} is not a controller of this study, which has {known}"
                )
            given[name] = (file_of(setting), self.own_laws[name][1])
        for name, (setting, _) in self.own_laws.items():
            if name not in given:
                raise OptionError(
                    f"{name} is a controller in a file, {setting}, and a file that a folder names "
                    f"is not run: give it again, with -c {setting}"
                )
        for law in self.laws:
            law.known()
        return dataclasses.replace(design, own_laws=given)

    def check_files(self, controllers: Sequence[str]) -> None:
        """Check that files of controllers are those of the study; none is run.

        Raises:
            OptionError: one is another file, has changed, or cannot be read.
        """
        known = {sha256 for _, sha256 in self.own_laws.values()}
        for setting in controllers:
            if FILE_SETTING.fullmatch(setting) and file_sha256(setting) not in known:
                files = ", ".join(setting for setting, _ in self.own_laws.values()) or "none"
                raise OptionError(
                    f"{setting} is another file of a controller than when the study began, or has "
                    f"changed since; the study has {files}, and all participants do the same: "
                    "restore it, or begin another study in another folder"
                )

    def check_unchanged(self) -> None:
        """Check that scenario and controllers are what they were when the study began.

        Raises:
            OptionError: they are not.
        """
        for setting, sha256 in self.own_laws.values():
            if file_sha256(setting) != sha256:
                raise OptionError(
                    f"the controller {setting} is not what it was when the study began, and all "
                    "participants do the same: restore it, or begin another study in another "
                    "folder"
                )
        now = scenario_sha256(self.scenario, self.arm)
        if self.scenario_sha256 and self.scenario_sha256 != now:
            raise OptionError(self._changed_scenario())

    def to_json(self) -> str:
        """As a file keeps it: files of controllers without their folders, which are private."""
        own = {name: (Path(file).name, sha256) for name, (file, sha256) in self.own_laws.items()}
        laws = [law.to_json() for law in self.laws]
        data = dataclasses.asdict(self) | {"laws": laws, "own_laws": own}
        return json.dumps(data, indent=1) + "\n"

    @classmethod
    def load(cls, folder: Path) -> Self:
        """The design of the study in a folder; no file that it names is run, see with_files().

        Raises:
            OptionError: there is none, or it is damaged.
        """
        file = folder / FILE
        try:
            data: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
            own = data.get("own_laws", {})
            data["own_laws"] = {name: (setting, sha256) for name, (setting, sha256) in own.items()}
            data["laws"] = tuple(map(Law.from_json, data["laws"]))
            data["task"] = Search(**data["task"])
            return cls(**data)
        except FileNotFoundError as error:
            raise OptionError(
                f"{folder} has no study with people: no {FILE}; begin one with "
                f"rcmqp trial camera_task --out {folder}"
            ) from error
        except (OSError, ValueError, TypeError, KeyError, RcmqpError) as error:
            raise OptionError(f"{file} is damaged: {error}") from error

    def keep(self, folder: Path) -> None:
        """Write the design of a new study; of one that has begun, check that it is the same.

        Raises:
            OptionError: the study in the folder has another design, or another scenario by then.
            RunFileError: it cannot be written.
        """
        if not (folder / FILE).exists():
            write_text(folder / FILE, self.to_json())
            return
        kept = Design.load(folder)
        for item in dataclasses.fields(Design):
            before, now = getattr(kept, item.name), getattr(self, item.name)
            if item.name == "own_laws":  # wherever the files are
                before, now = ({k: sha for k, (_, sha) in of.items()} for of in (before, now))
            if item.name == "scenario":
                before, now = map(_place_apart, (before, now))
            if item.name == "scenario_sha256":
                if before and now and before != now:
                    raise OptionError(self._changed_scenario())
                continue
            if before != now:
                what = {
                    "laws": "set of controllers and periods",
                    "own_laws": "file of a controller",
                }.get(item.name, item.name)
                raise OptionError(
                    f"{folder} is a study with another {what}; all participants do the "
                    "same: give the same options as before, or another folder"
                )

    def _changed_scenario(self) -> str:
        return (
            f"the scenario {self.scenario} is not what it was when the study began, and all "
            "participants do the same: restore it, or begin another study in another folder"
        )


def _place_apart(scenario: str) -> str:
    """A scenario's name, or the name of its Python file without the folders."""
    return Path(scenario).name if scenario.endswith(".py") else scenario


def file_of(setting: str) -> str:
    """FILE.py or FILE.py:CLASS of a setting, without options."""
    found = FILE_SETTING.fullmatch(setting)
    if found is None:
        raise OptionError(f"{setting} is not a controller's file; give FILE.py or FILE.py:CLASS")
    return found["file"] + (f":{found['name']}" if found["name"] else "")
