"""An operator at the device, doing the camera task: one run, and the way round an obstacle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rcmqp.maths.dualquaternion import Array
from rcmqp.references.hand import HandMapping, HandView
from rcmqp.references.operators.camera_task import CameraTask
from rcmqp.references.operators.hand import Encoder, Hand, Omega7, Submovement, duration
from rcmqp.references.operators.learning import Learning
from rcmqp.references.operators.perception import Eyes
from rcmqp.references.operators.population import Operator
from rcmqp.references.view import ViewCommand
from rcmqp.world.insertion import Insertion
from rcmqp.world.instrument import Vector3
from rcmqp.world.obstacles import Sphere, clearance

CUT = 0.9
"""Share of the distance that start and goal have, up to which a way can keep its own."""

PARTS = np.linspace(0.0, 1.0, 33)[:, None]
"""Places of a way that are looked at, as parts of it."""


def passing(start: Vector3, goal: Vector3, obstacle: Sphere) -> Array:
    """How far (n,) [m] the shaft's axis is from the obstacle's centre along a straight way.

    From the first place to the last; the shaft is all of it that is inside, trocar to tip.

    Args:
        start: (3,) of the tip, seen from the trocar, z into the patient [m].
        goal: (3,) likewise.
        obstacle: likewise.
    """
    first = np.array(start)
    tip = first + PARTS * (np.array(goal) - first)
    return clearance(tip, np.zeros_like(tip), obstacle) + obstacle.radius


def is_clear(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> bool:
    """Whether the shaft keeps its distance [m] from the obstacle's centre on the straight way.

    A way cannot keep more than its ends have; the distance is cut to CUT times that. A way that
    leads away from the obstacle is clear.
    """
    away = passing(start, goal, obstacle)
    nearest = int(np.argmin(away))
    return nearest == 0 or bool(away[nearest] >= _kept(start, goal, obstacle, distance))


def via_point(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> Vector3 | None:
    """A point on the way so that both straight parts keep their distance; None if not needed.

    The point is off the middle between start and goal, in equal parts towards the axis through
    the trocar, on which the camera started, and back out of the patient: withdrawn, the camera
    sees more.

    Args:
        start: (3,) seen from the trocar, z into the patient [m].
        goal: (3,) likewise [m]; as far from the obstacle as the start, or nearly.
        obstacle: likewise.
        distance: wanted from the obstacle's centre [m]; cut as in is_clear().
    """
    if is_clear(start, goal, obstacle, distance):
        return None
    distance = _kept(start, goal, obstacle, distance)
    room = math.dist(start, obstacle.centre)
    aside = room * distance / math.sqrt(room**2 - distance**2)
    x, y, z = ((s + g) / 2.0 for s, g in zip(start, goal, strict=True))
    off = math.hypot(x, y)
    if off < 1e-9:
        return x, y, z - aside
    part = aside / math.sqrt(2.0)
    return x * (1.0 - part / off), y * (1.0 - part / off), z - part


def _kept(start: Vector3, goal: Vector3, obstacle: Sphere, distance: float) -> float:
    """The distance [m] that a way between two points can keep."""
    room = min(math.dist(start, obstacle.centre), math.dist(goal, obstacle.centre))
    return min(distance, CUT * room)


NEAR = 0.008
"""Perceived distance from the point beside the obstacle from which on it counts as passed [m]."""


def recognition_times(
    operator: Operator,
    objectives: int,
    seed: int,
    learning: Learning | None = None,
    starts: Sequence[float] = (),
) -> list[float]:
    """How long the operator looks before each objective [s].

    Args:
        operator: who looks.
        objectives: how many there are.
        seed: see Steering.
        learning: of a novice, if any.
        starts: with ``learning``, when each objective is shown [s]; one for each objective.
    """
    rng = np.random.default_rng(_streams(seed)[0])
    shape = operator.recognition_shape
    people = [operator] * objectives
    if learning is not None:
        people = [learning.person(operator, t) for t in starts]
    return [person.recognition * float(rng.gamma(shape)) / shape for person in people]


class Steering:
    """The views that one operator asks for, cycle by cycle.

    Before each objective the operator looks at the pictures; then submovements follow each
    other. Each is decided on what the camera showed ``delay`` ago: the perceived way to the goal
    in the image's axes, short by ``gain``, scattered by the noise of the muscles. The
    next one is decided when the last has been seen to end, and not before ``interval``. Where
    nothing is to be seen, the hand goes half-way back to where it started and all was in view;
    further out of the patient than that it is never meant to go.

    Round the obstacle the operator goes by way of a point beside it, until that seems near and
    the straight way to the objective clear; or near for the second time. The point is such that
    the shaft would keep the margin and ``caution`` standard deviations of what the last part of
    the way, without correction, would be off when it passes; clear is a way that keeps half of
    that. A movement once begun is carried out, whatever it leads to: the camera looks ahead, and
    nobody sees the shaft come to the obstacle.

    How the scene is laid out, the operator knows from the pictures and the first image, where it
    is from the camera's images, late and inexactly, see Eyes; neither joints nor poses, nor which
    controller moves the arm. That an objective is reached, and the next one due, is told.

    Chance is four streams out of one seed: recognition, tremor, perception, movement. What is
    drawn for one does not shift another.
    """

    def __init__(
        self,
        operator: Operator,
        task: CameraTask,
        device: Omega7,
        mapping: HandMapping,
        insertion: Insertion,
        period: float,
        seed: int,
        learning: Learning | None = None,
    ) -> None:
        """At the start, the first objective just shown."""
        self._task, self._seed = task, seed
        self._untaught, self._learning, self._starts = operator, learning, list[float]()
        self._operator = operator
        self._targets = task.targets
        _, tremor, perception, movement = _streams(seed)
        self._hand = Hand(operator, device, period, np.random.default_rng(tremor))
        self._encoder = Encoder(device, period)
        self._view = HandView(mapping, insertion)
        self._turned = insertion.instrument.camera.rotation
        self._eyes = Eyes(operator, task, insertion, np.random.default_rng(perception))
        self._rng = np.random.default_rng(movement)
        self._touching = task.obstacle_radius + insertion.instrument.radius
        self._scale = mapping.scale
        self._move = Submovement((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 1.0)
        self.objective = 0
        self._via: Vector3 | None = None
        self._turn = 0.0
        self._start_objective(0.0, (0.0, 0.0, insertion.tip_depth))

    def command(self, t: float, x: Array) -> ViewCommand | None:
        """The view asked for at ``t`` [s]; None when the last objective is reached.

        Args:
            t: one period after the last call.
            x: (8,) effector pose, now, which the camera shows.
        """
        tip = self._eyes.tip(x)
        if math.dist(tip, self._targets[self.objective]) <= self._task.tolerance:
            self.objective += 1
            if self.objective == len(self._targets):
                return None
            self._start_objective(t, self._targets[self.objective - 1])
        self._eyes.look(t, x)
        if t >= self._next:
            self._decide(t)
        state = self._encoder.read(self.hand)
        self._hand.step(self._move.position(t))
        return self._view.ask(state)

    @property
    def hand(self) -> Vector3:
        """Where the hand (3,) is, from its start [m]."""
        return self._hand.position

    def _learn(self, t: float) -> None:
        """Let the time at the device, ``t`` [s] of it in the trial, change the operator."""
        if self._learning is not None:
            self._operator = self._learning.person(self._untaught, t)
            self._eyes.operator = self._operator

    def _start_objective(self, t: float, start: Vector3) -> None:
        """The pictures of the next objective are shown at ``t`` [s], at ``start`` (3,) [m]."""
        goal, obstacle = self._targets[self.objective], self._task.obstacle
        self._learn(t)
        self._eyes.remember()
        operator, touching = self._operator, self._touching
        self._via = via_point(start, goal, obstacle, touching + operator.margin)
        if self._via is not None:
            wanted = operator.margin + operator.caution * self._passing_error(self._via, goal)
            self._via = via_point(start, goal, obstacle, touching + wanted)
            self._turn = touching + wanted / 2.0
        self._passed = False
        self._starts.append(t)
        looking = recognition_times(
            self._untaught, len(self._starts), self._seed, self._learning, self._starts
        )
        self._next = t + operator.delay + looking[-1]

    def _passing_error(self, start: Vector3, goal: Vector3) -> float:
        """Standard deviation [m] of a movement's error in the middle of a way.

        Half of that at its end: the muscles' noise, and the error of what is seen in depth.
        """
        operator, length = self._operator, math.dist(start, goal)
        deep = operator.floor_depth + operator.weber_depth * abs(goal[2] - start[2])
        deep += operator.weber_cross * length
        return 0.5 * math.hypot(operator.motor_noise * length, deep)

    def _decide(self, t: float) -> None:
        """Begin a submovement at ``t`` [s]."""
        self._learn(t)
        operator = self._operator
        goal = self._targets[self.objective]
        away = self._perceived(t)
        if self._via is not None and away is not None and math.hypot(*away) < NEAR:
            seems = self._eyes.place(self._via, away)
            if self._passed or is_clear(seems, goal, self._task.obstacle, self._turn):
                self._via = None
            self._passed = True
            if self._via is None:
                away = self._perceived(t)
        here = self._move.position(t)
        if away is None:  # nothing to be seen: back towards where there was
            x, y, z = (-0.5 * a for a in here)
        else:
            x, y, z = (operator.gain * a / self._scale for a in away)
        length = math.hypot(x, y, z)
        noise = (operator.motor_noise * length * self._rng.normal(size=3)).tolist()
        way = self._inside(here, (x + noise[0], y + noise[1], z + noise[2]))
        lasts = duration(operator, math.hypot(*way))
        self._move = Submovement(here, way, t, lasts)
        self._next = t + max(operator.interval, lasts + 0.9 * operator.delay)

    def _inside(self, here: Vector3, way: Vector3) -> Vector3:
        """A way (3,) of the hand, cut so that the tip is not drawn out past where it started."""
        x, y, z = (self._turned @ np.array(way)).tolist()
        deep = float(self._turned[2] @ np.array(here))
        a, b, c = (self._turned.T @ np.array([x, y, max(z, -deep)])).tolist()
        return a, b, c

    def _perceived(self, t: float) -> Vector3 | None:
        """The way (3,) [m] to the point beside the obstacle, or to the objective; see Eyes."""
        if self._via is not None:
            return self._eyes.perceive(t, self._via, self._task.obstacle.centre)
        goal = self._targets[self.objective]
        return self._eyes.perceive(t, goal, self._task.spheres[self.objective].centre)


def _streams(seed: int) -> list[np.random.SeedSequence]:
    return np.random.SeedSequence(seed).spawn(4)
