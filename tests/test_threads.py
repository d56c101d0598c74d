"""A thread that shows an arm beside a control loop does not disturb the loop's states."""

from __future__ import annotations

import copy
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from rcmqp import Arm, load_arm

COUNT = 20_000


@pytest.fixture(autouse=True)
def _often() -> Iterator[None]:
    """Let threads take turns as often as may be."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


def torn(arms: tuple[Arm, Arm]) -> list[int]:
    """How many states of two threads, each at a posture of its own, are of another posture."""
    postures = [arms[0].home, arms[1].home + 0.3]
    expected = [arm.state(q) for arm, q in zip(arms, postures, strict=True)]
    points = [arm.skeleton(q) for arm, q in zip(arms, postures, strict=True)]
    wrong, done = [0, 0], [0, 0]

    def ask(i: int) -> None:
        for k in range(COUNT):
            state = arms[i].state(postures[i])
            same = np.array_equal(state.J_local, expected[i].J_local)
            same = same and np.array_equal(state.x, expected[i].x)
            if k % 50 == 0:
                same = same and np.array_equal(arms[i].skeleton(postures[i]), points[i])
            wrong[i] += not same
            done[i] += 1

    threads = [threading.Thread(target=ask, args=(i,)) for i in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert done == [COUNT, COUNT]
    return wrong


def test_two_threads_at_one_arm_get_whole_states() -> None:
    arm = load_arm("panda")
    assert torn((arm, arm)) == [0, 0]


def test_a_copy_of_an_arm_shares_nothing_that_is_written_to() -> None:
    arm = load_arm("panda")
    other = copy.deepcopy(arm)
    assert_array_equal(other.state(arm.home).J_local, arm.state(arm.home).J_local)
    assert torn((arm, other)) == [0, 0]
