from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import joblib
import pytest

from rcmqp import Arm, Insertion, Instrument, Run, Scenario, arm_names, load_arm, load_scenario
from rcmqp.controllers import CONTROLLERS

if TYPE_CHECKING:
    from helpers import Call
    from opened import Opened


SLOW = """
approach at_rest baselines behaviour benchmarks carried cli cli_refusals compare
compare_resumed contour damaged dampers doc_tables docs dual_quaternion_controller
dual_quaternion_options experiment_a experiment_b governor hands hostile image_upright
joint_limits learning live_console live_devices live_failures live_server live_trial
loop_record loopback operator_hands operators package plugins promises qp_oracle readme report
reproduce run_file safe_stop simulate stress study study_command study_tables study_trials
task_reconstruction untrusted vfi_qp viewer viewer_capture viewer_live viewer_odd viewer_page
viewer_picture viewer_shapes watchdog
"""
"""Files test_*.py that `make test-fast` leaves out: browsers, studies, many runs, processes."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is in the slow files."""
    for item in items:
        if item.path.stem.removeprefix("test_") in SLOW.split():
            item.add_marker("slow")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was left out."""
    if terminalreporter.config.option.markexpr == "not slow":
        terminalreporter.section("left out, make test runs them")
        terminalreporter.write_line(" ".join(SLOW.split()))


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


@pytest.fixture(autouse=True)
def _no_controllers_left() -> Iterator[None]:
    """Remove the controllers that a test registers."""
    before = set(CONTROLLERS)
    yield
    for name in set(CONTROLLERS) - before:
        del CONTROLLERS[name]


@pytest.fixture(scope="module")
def opened(runs: list[Run], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Opened]:
    """The page of a test file's ``runs`` in a browser."""
    from opened import opening  # matplotlib takes long to import

    with opening(runs, tmp_path_factory.mktemp("page")) as page:
        yield page


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """Run a command line: exit code, stdout, stderr."""
    from rcmqp.cli import main  # it takes long to import

    def run(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main(arguments)
        code = stop.value.code
        return int(code or 0), *capsys.readouterr()

    return run


@pytest.fixture
def short(tmp_path: Path) -> str:
    """The camera task, ended after 0.4 s, as a scenario's file."""
    from short_study import SHORT

    file = tmp_path / "short.py"
    file.write_text(SHORT.format(duration=0.4), encoding="utf-8")
    return str(file)


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
