"""Whether an arm runs into itself, or its instrument into the arm; distances come from coal."""

from __future__ import annotations

from itertools import combinations

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from rcmqp.world.arm import Arm
from rcmqp.world.geometry import geometry_of, hangs_on
from rcmqp.world.instrument import Instrument

LINK_RADIUS = 0.03
"""Of the capsules that stand for links without shapes [m]."""

SHAFT = "the shaft"

SAMPLES, ALWAYS = 40, 0.5
"""Random configurations; two shapes that touch in more than this share of them are built so."""


class Collisions:
    """Shapes of an arm with an instrument, and the pairs of them that may run into each other.

    Shapes are the collision shapes of the URDF, of meshes the convex hulls; without any, capsules
    from joint to joint. Links that hang on the same or on neighbouring joints are no pair.
    """

    def __init__(self, arm: Arm, instrument: Instrument) -> None:
        """Gather the shapes, and leave out the pairs that always touch."""
        self.arm = arm
        self._shapes = pin.GeometryModel()
        for name, joint, placement, shape in _links(arm):
            self._add(name, joint, placement, shape)
        start = instrument.mount_offset + 2.0 * instrument.radius
        length = instrument.tip - start
        middle = instrument.on_shaft(start + length / 2.0)
        capsule = coal.Capsule(instrument.radius, length)
        self._add(SHAFT, arm.last_joint, arm.jMflange * middle, capsule)
        self._data = arm.model.createData()
        self._pair()

    def first(self, angles: ArrayLike) -> str:
        """Names of two parts that touch at joint angles (nv,), such as "forearm and the shaft"."""
        q = self.arm.configuration(angles)
        if not pin.computeCollisions(
            self.arm.model, self._data, self._shapes, self._shapes_data, q, True
        ):
            return ""
        touching = self._touching()
        pair = self._shapes.collisionPairs[touching[0]]
        names = [self._shapes.geometryObjects[i].name for i in (pair.first, pair.second)]
        return " and ".join(names)

    def _add(
        self, name: str, joint: int, placement: pin.SE3, shape: coal.CollisionGeometry
    ) -> None:
        self._shapes.addGeometryObject(pin.GeometryObject(name, joint, placement, shape))

    def _pair(self) -> None:
        """Make the pairs, look at random configurations, and keep those that mean something."""
        objects = self._shapes.geometryObjects
        pairs = [
            pin.CollisionPair(i, j)
            for i, j in combinations(range(len(objects)), 2)
            if abs(objects[i].parentJoint - objects[j].parentJoint) >= 2
        ]
        for pair in pairs:
            self._shapes.addCollisionPair(pair)
        self._shapes_data = self._shapes.createData()
        counts, rng = np.zeros(len(pairs)), np.random.default_rng(0)
        for _ in range(SAMPLES):
            q = self.arm.configuration(self.arm.random_angles(rng))
            pin.computeCollisions(
                self.arm.model, self._data, self._shapes, self._shapes_data, q, False
            )
            counts[self._touching()] += 1
        for pair, count in zip(pairs, counts, strict=True):
            if count > ALWAYS * SAMPLES:
                self._shapes.removeCollisionPair(pair)
        self._shapes_data = self._shapes.createData()

    def _touching(self) -> list[int]:
        results = self._shapes_data.collisionResults
        return [i for i, result in enumerate(results) if result.isCollision()]


def _links(arm: Arm) -> list[tuple[str, int, pin.SE3, coal.CollisionGeometry]]:
    """Name, joint, placement in the joint's frame, and shape, of everything before the flange."""
    found = geometry_of(arm, pin.GeometryType.COLLISION)
    links = []
    for shape in () if found is None else found.shapes.geometryObjects:
        assert found is not None
        body = found.model.frames[shape.parentFrame]
        if hangs_on(found.model, shape.parentFrame, arm.flange):
            continue
        frame = arm.model.frames[arm.model.getFrameId(body.name, pin.FrameType.BODY)]
        placement = frame.placement * body.placement.actInv(shape.placement)
        links.append((body.name, frame.parentJoint, placement, _convex(shape.geometry)))
    return links or _capsules(arm)


def _convex(shape: coal.CollisionGeometry) -> coal.CollisionGeometry:
    if not isinstance(shape, coal.BVHModelBase):
        return shape
    shape.buildConvexHull(False, "Qt")
    return shape.convex


def _capsules(arm: Arm) -> list[tuple[str, int, pin.SE3, coal.CollisionGeometry]]:
    """Capsules from joint to joint, for an arm without shapes."""
    links = []
    for joint, end in enumerate([*list(arm.model.jointPlacements)[1:], arm.jMflange]):
        length = float(np.linalg.norm(end.translation))
        if length < 2.0 * LINK_RADIUS:
            continue
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end.translation / length)
        placement = pin.SE3(turn.matrix(), end.translation / 2.0)
        capsule = coal.Capsule(LINK_RADIUS, length - 2.0 * LINK_RADIUS)
        links.append((f"link {joint}", joint, placement, capsule))
    return links
