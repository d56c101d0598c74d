"""Promises of every limit, and what is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar, cast

import numpy as np
import pytest
from helpers import assert_allclose, random_placement
from limit_parts import ARMS, NEEDED, T, insertion, reference

from rcmqp.errors import InvalidProblem, RcmqpError
from rcmqp.limits import LIMITS, Constraint, EntrySphere, Limit, combine, make_limit
from rcmqp.maths import dualquaternion as dq
from rcmqp.maths.dualquaternion import Array
from rcmqp.references.view import Reference
from rcmqp.world.arm import ArmState


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("name", sorted(LIMITS))
def test_every_limit_is_sound_read_only_repeatable_and_remembers_nothing(
    name: str, arm: str
) -> None:
    inserted, rng = insertion(arm), np.random.default_rng(7)
    limit = make_limit(name, inserted, T, **NEEDED.get(name, {}))
    nv, starts = inserted.arm.nv, [inserted.angles_start, inserted.arm.random_angles(rng)]
    for angles in starts:
        state = inserted.state(inserted.arm.configuration(angles), rng.normal(size=nv))
        now = reference(np.array(inserted.trocar.pivot), rng.normal(size=3))
        found = limit.evaluate(state, now)
        kept = [array.copy() for array in arrays(found)]
        limit.evaluate(replace(state, v=state.v + 1.0), reference(now.pivot + 1.0))
        again = limit.evaluate(state, now)
        assert (found.lower <= found.upper).all()
        assert np.isfinite(found.C).all()
        assert np.isfinite(found.d).all()
        assert len(set(found.names)) == len(found.d) == len(found.C)
        for array, copy, rerun in zip(arrays(found), kept, arrays(again), strict=True):
            assert np.array_equal(array, copy)
            assert np.array_equal(array, rerun)
            assert not array.flags.writeable
            for shared in (*arrays(again), state.v, state.J_local, inserted.arm.velocity):
                assert not np.shares_memory(array, shared)


def arrays(found: Constraint) -> tuple[Array, Array, Array, Array]:
    return found.lower, found.upper, found.C, found.d


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_a_limit_at_rest_inside_allows_rest(name: str) -> None:
    """A standing arm inside every limit, over a still patient, may go on standing."""
    inserted = insertion("panda")
    tip = inserted.tip(inserted.x_rcm)
    inside: dict[str, Any] = {
        "keep_out": {"centre": tuple(tip + 0.2), "radius": 0.02},
        "keep_in": {"centre": tuple(tip), "radius": 0.2},
        "entry_sphere": {"centre": inserted.trocar.pivot, "radius": 0.01},
    }
    limit = make_limit(name, inserted, T, **inside.get(name, {}))
    state = inserted.state(inserted.q_start)
    found = limit.evaluate(state, reference(np.array(inserted.trocar.pivot)))
    assert (found.lower <= 0.0).all()
    assert (found.upper >= 0.0).all()
    assert (found.d >= 0.0).all()


@dataclass(frozen=True, eq=False)
class Box(Limit):
    """A user's limit: the same box for every joint."""

    name: ClassVar[str] = "box"

    low: float
    high: float

    def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
        n = state.angles.size
        return Constraint.box(np.full(n, self.low), np.full(n, self.high))


def test_limits_combine_to_one_box_and_all_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, Box.name, Box)
    inserted = insertion("ur5")
    state, now = inserted.state(inserted.q_start), reference(np.ones(3))
    depth, cone = (make_limit(name, inserted, T) for name in ("trocar_depth", "trocar_cone"))
    wide, left, right = Box(-1.0, 1.0), Box(-2.0, 0.3), Box(0.1, 5.0)
    user = make_limit("box", inserted, T, low=0.5, high=0.7)
    assert_allclose(user.evaluate(state, now).upper, 0.7)

    bounds = combine([wide, depth, left, cone, right], state, now, inserted.arm.joints)
    assert_allclose(bounds.lower, 0.1, rtol=0, atol=0)
    assert_allclose(bounds.upper, 0.3, rtol=0, atol=0)
    parts = [limit.evaluate(state, now) for limit in (depth, cone)]
    assert_allclose(bounds.C, np.vstack([part.C for part in parts]), rtol=0, atol=0)
    assert_allclose(bounds.d, np.concatenate([part.d for part in parts]), rtol=0, atol=0)
    assert bounds.names[5:] == (
        "wrist_3_joint",
        "trocar depth, deepest",
        "trocar depth, shallowest",
        "trocar cone",
    )
    for first, then, held in ((left, user, 0.3), (user, left, 0.5)):  # the first listed wins
        bounds = combine([first, then], state, now)
        assert_allclose(bounds.lower, held, rtol=0, atol=0)
        assert_allclose(bounds.upper, held, rtol=0, atol=0)
    free = combine([], state, now)
    assert np.isposinf(free.upper - free.lower).all()
    assert free.C.shape == (0, 6)
    assert free.names[0] == "v[0]"


BALL: dict[str, Any] = {"centre": (0.0, 0.0, 0.0), "radius": 0.1}


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("trocar_con", {}, r"unknown limit 'trocar_con'; did you mean trocar_cone"),
        ("trocar_cone", {"gian": 1.0}, r"unknown option of trocar_cone 'gian'; did you mean gain"),
        ("trocar_cone", {"gain": 0.0}, r"gain = 0.0 1/s, it must be positive"),
        ("trocar_cone", {"deceleration": 0.0}, r"deceleration = 0.0, it must be positive, inf"),
        ("trocar_depth", {"gain": 1001.0}, r"= 1; a damper keeps its limit up to 1: lower the"),
        ("keep_out", {"radius": 0.1}, r"KeepOut needs centre; give a value"),
        ("keep_in", {}, r"KeepIn needs centre and radius; give a value for each"),
        ("keep_out", BALL | {"radius": 0.0}, r"radius = 0.0 m, it must be positive"),
        ("keep_out", BALL | {"centre": (0.0, 1.0)}, r"centre = \(0.0, 1.0\), it must be three"),
        ("keep_out", BALL | {"velocity": (0.0, 1.0, np.nan)}, r"velocity = .* three finite"),
        ("keep_out", BALL | {"part": "shft"}, r"unknown part .* 'shft'; did you mean shaft"),
        ("keep_in", BALL | {"part": "x"}, r"unknown part .*known: shaft, tip"),
        ("keep_in", BALL | {"radius": 0.005}, r"radius = 0.005 m leaves no room for a shaft of"),
        ("entry_sphere", BALL | {"radius": 0.004}, r"radius = 0.004 m leaves no room for a shaft"),
    ],
)
def test_a_bad_name_or_option_is_refused(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RcmqpError, match=message):
        make_limit(name, insertion("ur5"), T, **options)


def test_a_constraint_of_parts_that_do_not_fit_is_refused() -> None:
    with pytest.raises(InvalidProblem, match=r"\(2, 6\), \(1,\)\); they must be .* \(m, nv\) and"):
        Constraint(np.zeros(6), np.ones(6), np.zeros((2, 6)), np.zeros(1), ("one",))
    for names in ((), ("one", "two")):
        with pytest.raises(InvalidProblem, match=f"1 rows, and there are {len(names)} names"):
            Constraint.rows(np.zeros((1, 6)), np.zeros(1), names)


@pytest.mark.parametrize("low", [2.0, np.nan])
def test_an_empty_box_is_refused(low: float) -> None:
    with pytest.raises(InvalidProblem, match=rf"lower = \[.*{low:g}.*leave an empty box"):
        Constraint.box([-1.0, low], [1.0, 1.0])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, r"^Given\.evaluate\(\) returned None, it must be a Constraint$"),
        (Constraint.box(-np.ones(5), np.ones(5)), r"^Given is for 5 joints, the arm has 6$"),
        (Constraint.rows(np.ones((1, 7)), [1.0], ["x"]), r"^Given is for 7 joints"),
        (InvalidProblem("wrong"), r"^Given: wrong$"),
    ],
    ids=["nothing", "box", "row", "error"],
)
def test_what_is_no_constraint_is_refused_by_the_limits_name(answer: Any, message: str) -> None:
    class Given(Limit):
        def evaluate(self, state: ArmState, reference: Reference) -> Constraint:
            if isinstance(answer, Exception):
                raise answer
            return cast(Constraint, answer)

    inserted = insertion("ur5")
    with pytest.raises(InvalidProblem, match=message):
        combine([Given()], inserted.state(inserted.q_start), reference(np.ones(3)))


def test_a_constraint_copies_what_it_is_given() -> None:
    given = -np.ones(6), np.ones(6), np.zeros((1, 6)), np.zeros(1)
    for mine, kept in zip(given, arrays(Constraint(*given, names=("row",))), strict=True):
        assert mine.flags.writeable
        assert not np.shares_memory(mine, kept)


def test_entry_sphere_bounds_the_rcm_error() -> None:
    """Marinho's tube: a shaft inside it misses the trocar by the sphere's radius at the most."""
    inserted = insertion("panda")
    rng = np.random.default_rng(7)
    state = inserted.state(inserted.q_start)
    pivot = np.array(inserted.trocar.pivot)
    limit = make_limit("entry_sphere", inserted, T, centre=(0, 0, 0), radius=0.01, on_trocar=True)
    assert isinstance(limit, EntrySphere)
    for _ in range(20):
        oMe = state.oMe * random_placement(rng)
        seen = oMe.actInv(pivot)
        moved = replace(state, oMe=oMe, x=dq.from_se3(oMe))
        found = limit.evaluate(moved, reference(pivot))
        if inserted.tip_depth + limit.mount < seen[2] < inserted.tip_depth:
            miss = math.hypot(seen[0], seen[1])
            assert found.d[0] == pytest.approx(60.0 * (0.005 - miss))
