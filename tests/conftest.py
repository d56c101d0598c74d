from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING

import joblib
import pytest

from rcmqp import Arm, Insertion, Instrument, Run, Scenario, arm_names, load_arm, load_scenario

if TYPE_CHECKING:
    from opened import Opened


@pytest.fixture(scope="session", params=arm_names())
def arm(request: pytest.FixtureRequest) -> Arm:
    """Every registered arm, one after the other; it keeps no state between calls."""
    return load_arm(request.param)


@pytest.fixture(scope="session")
def lwa3() -> Arm:
    """A spherical-revolute-spherical arm whose numbers are known in closed form."""
    return load_arm("lwa3")


@pytest.fixture(scope="session")
def insertion() -> Insertion:
    """The Panda at its home, the trocar where its shaft is."""
    return Insertion.on_shaft(load_arm("panda"), Instrument())


@pytest.fixture(scope="session")
def helix() -> Scenario:
    """The paper's helix on the LWA3."""
    return load_scenario("conical_helix", "lwa3")


@pytest.fixture(scope="module")
def opened(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    """The page of a test file's ``runs`` in a browser."""
    from opened import opening  # matplotlib takes long to import

    with opening(runs, tmp_path_factory.mktemp("page")) as page:
        yield page


@pytest.fixture
def dask() -> Iterator[None]:
    """Joblib's work goes to a Dask cluster of two workers on this machine."""
    distributed = pytest.importorskip("distributed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask's own
        options = {"n_workers": 2, "threads_per_worker": 1, "processes": False}
        with (
            distributed.LocalCluster(**options, dashboard_address=None) as cluster,
            distributed.Client(cluster),
            joblib.parallel_config("dask"),
        ):
            yield
