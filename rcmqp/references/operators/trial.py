"""The camera task as a scenario's path: it depends on what the camera shows."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import TypeVar

from rcmqp.errors import OptionError
from rcmqp.maths.options import options, or_none, part, positive
from rcmqp.references.hand import HandMapping
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.operators.hand import Omega7
from rcmqp.references.operators.learning import Learning
from rcmqp.references.operators.population import Operator
from rcmqp.references.operators.steering import Steering
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Camera, Vector3
from rcmqp.world.obstacles import Sphere

P = TypeVar("P")


@options
@dataclass(frozen=True, slots=True)
class CameraTrial:
    """One operator, one device, one task; ends when the task is done.

    Attributes:
        operator: who steers.
        task: what is to be shown.
        device: what is in the operator's hand.
        mapping: from the hand's way to the view.
        duration: after which the trial ends, done or not [s].
        learning: how a novice becomes better by practice, before the trial and in it; None for
            people who stay as they are, which is the model of the study.
    """

    operator: Operator = field(default_factory=Operator, metadata=part(Operator))
    task: CameraTask = field(default_factory=CameraTask, metadata=part(CameraTask))
    device: Omega7 = field(default_factory=Omega7, metadata=part(Omega7))
    mapping: HandMapping = field(default_factory=HandMapping, metadata=part(HandMapping))
    duration: float = field(default=600.0, metadata=positive("s"))
    learning: Learning | None = field(default=None, metadata=or_none(part(Learning)))

    def targets(self, tip_depth: float) -> tuple[Vector3, ...]:
        """The task's objectives; see rcmqp.references.paths.Shows."""
        return self.task.targets

    @property
    def spheres(self) -> tuple[Sphere, ...]:
        """The spheres that the task asks to be shown."""
        return self.task.spheres

    def start(self, insertion: Insertion, period: float, seed: int) -> Steering:
        """The operator at the device; equal arguments do the same to the bit.

        Raises:
            OptionError: an objective is out of the device's reach.
        """
        for i, target in enumerate(self.task.targets):
            far = math.hypot(*self.mapping.way(target, insertion.tip_depth))
            if far > self.device.radius:
                raise OptionError(
                    f"objective {i + 1} is {1e3 * far:.0f} mm of the hand away, the device "
                    f"reaches {1e3 * self.device.radius:.0f} mm: a larger scale than "
                    f"{self.mapping.scale} brings it nearer"
                )
        return Steering(
            self.operator,
            self.task,
            self.device,
            self.mapping,
            insertion,
            period,
            seed,
            self.learning,
        )


def camera_trial(path: object, scenario: str) -> CameraTrial:
    """The path of a scenario, in which a study can put its people.

    Args:
        path: any path.
        scenario: what the scenario is called.

    Raises:
        OptionError: the path is not a CameraTrial.
    """
    if isinstance(path, CameraTrial):
        return path
    raise OptionError(
        f"nobody steers in {scenario}: its path is a {type(path).__name__}; a study needs a "
        "CameraTrial, as camera_task has"
    )


def seen_by(path: P, camera: Camera) -> P:
    """A path for this camera: the spheres of a CameraTrial where the camera looks at the start."""
    if not isinstance(path, CameraTrial):
        return path
    a, b, c = camera.rotation[:, 2].tolist()
    return dataclasses.replace(path, task=dataclasses.replace(path.task, towards=(a, b, c)))
