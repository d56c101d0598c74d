from __future__ import annotations

import pytest

from rcmqp import Arm, arm_names, load_arm


@pytest.fixture(scope="session", params=arm_names())
def arm(request: pytest.FixtureRequest) -> Arm:
    """Every registered arm, one after the other; it keeps no state between calls."""
    return load_arm(request.param)


@pytest.fixture(scope="session")
def lwa3() -> Arm:
    """A spherical-revolute-spherical arm whose numbers are known in closed form."""
    return load_arm("lwa3")
