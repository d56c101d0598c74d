"""What other distributions add by entry points: found by name, in every process."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rcmqp import load_arm, load_scenario, make_controller
from rcmqp.cli import main
from rcmqp.controllers import CONTROLLERS, DualQuaternion
from rcmqp.errors import OptionError, PluginError, UnknownName
from rcmqp.plants import PLANTS
from rcmqp.references.operators import STEERED
from rcmqp.references.paths import PATHS
from rcmqp.runs.loading import scenario_module
from rcmqp.world import plugins
from rcmqp.world.motions import MOTIONS

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`([\w./]+)`:\n\n```\w+\n(.*?)```$", GUIDE, re.MULTILINE | re.DOTALL))


@pytest.fixture(scope="module")
def keyhole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder where pip installed the guide's package."""
    pytest.importorskip("setuptools", minversion="77")  # as its pyproject.toml has it, no network
    source, target = (tmp_path_factory.mktemp(name) for name in ("source", "installed"))
    for name, text in FILES.items():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", "--no-deps"]
    command += ["--no-build-isolation", "--no-index", "--target", str(target), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert not done.returncode, f"{done.stdout}{done.stderr}"
    return target


def run(keyhole: Path, program: str, folder: Path) -> str:
    """What a program prints that has the plug-in on its path, and nothing but its name."""
    file = folder / "program.py"
    file.write_text(program, encoding="utf-8")
    path = os.pathsep.join([str(keyhole), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, str(file)],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert not done.returncode, done.stderr
    return done.stdout


HERE = """
import sys
from rcmqp import Run, arm_names, load_arm, load_scenario, make_controller, scenario_names
from rcmqp import simulate
from rcmqp.plants import PLANTS
from rcmqp.references.paths import PATHS
from rcmqp.runs.scenario import Scenario

assert not any(name.startswith("keyhole") for name in sys.modules)
assert "benchtop" in arm_names() and "nodding" in scenario_names()
assert not any(name.startswith("keyhole") for name in sys.modules)  # listed, not loaded
assert load_arm("benchtop").title == "Panda on the bench"
scenario = load_scenario("nodding")
assert Scenario.from_json(scenario.to_json()) == scenario
assert type(scenario.path) is PATHS["nod"] and type(scenario.plant) is PLANTS["lag"]
run = simulate(scenario, make_controller("gentle", scenario.insertion(), scenario.period))
run.save("run.h5")
again = Run.load("run.h5")
assert again.digest == run.digest
print(again.scenario.arm, again.scenario.plant, again.controller, 1e3 * run.rcm_error.max() < 1.0)
"""


def test_the_guides_package_is_known_by_name(keyhole: Path, tmp_path: Path) -> None:
    expected = "benchtop Lag(time_constant=0.005) gentle True\n"
    assert run(keyhole, HERE, tmp_path) == expected


ARM = """
from rcmqp import load_arm
print(load_arm("benchtop").sha256 != load_arm("panda").sha256)
"""


def test_the_file_of_a_plug_ins_arm_is_part_of_what_the_arm_was_read_from(
    keyhole: Path, tmp_path: Path
) -> None:
    assert run(keyhole, ARM, tmp_path) == "True\n"


WORKERS = """
import os
import sys

import distributed
import joblib
from rcmqp import load_scenario, make_controller, simulate

def digest(arm):
    before = [name for name in sys.modules if name.startswith("keyhole")]
    scenario = load_scenario("nodding", arm, duration=0.1)
    controller = make_controller("gentle", scenario.insertion(), scenario.period)
    return os.getpid(), before, simulate(scenario, controller).digest

def digests():
    work = joblib.Parallel(n_jobs=2)
    return work(joblib.delayed(digest)(arm) for arm in ("benchtop", "lwa3"))

if __name__ == "__main__":
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    loky = digests()
    with (
        distributed.LocalCluster(**options) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config("dask"),
    ):
        dask = digests()
    assert os.getpid() not in {pid for pid, _, _ in loky + dask}
    assert loky[0][1] == dask[0][1] == []  # nothing of the plug-in came along
    here = [digest(arm)[2] for arm in ("benchtop", "lwa3")]
    print([found[2] for found in loky] == [found[2] for found in dask] == here)
"""


def test_worker_processes_of_loky_and_dask_know_the_names(keyhole: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    assert run(keyhole, WORKERS, tmp_path) == "True\n"


STUDY = """
from rcmqp.controllers import CONTROLLERS
from rcmqp.runs.setup import run_command
from rcmqp import load_scenario, make_controller, simulate
from rcmqp.world.plugins import distributions_of

print(distributions_of(CONTROLLERS["gentle"]))
scenario = load_scenario("nodding", duration=0.1)
run = simulate(scenario, make_controller("gentle", scenario.insertion(), scenario.period))
print(run_command(run, "nodding.json", "run.h5"))
"""


def test_studies_know_its_version_and_reports_its_command(keyhole: Path, tmp_path: Path) -> None:
    versions, command = run(keyhole, STUDY, tmp_path).splitlines()
    assert versions == "['rcmqp-keyhole 1.0']"
    assert command.startswith("rcmqp run nodding.json --controller gentle ")


def test_the_guide_has_every_group_and_every_file() -> None:
    assert re.findall(r"^\| `(rcmqp\.\w+)`", GUIDE, re.MULTILINE) != []
    assert set(re.findall(r"^\| `(rcmqp\.\w+)`", GUIDE, re.MULTILINE)) == set(plugins.GROUPS)
    registries = (CONTROLLERS, MOTIONS, PATHS, PLANTS, STEERED)
    others = {"rcmqp.arms", "rcmqp.scenarios"}
    assert {registry.group for registry in registries} | others == set(plugins.GROUPS)
    assert len(FILES) == 8


# What goes wrong ---------------------------------------------------------------------------


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the path; see install()."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def install(folder: Path, name: str, group: str, point: str) -> None:
    """Put a distribution's metadata into a folder, with one entry point."""
    info = folder / f"{name}-2.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 2.5\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{point}\n")


def test_what_cannot_be_imported_is_a_sentence_that_names_the_distribution(
    installed: Path,
) -> None:
    install(installed, "sharp", "rcmqp.controllers", "sharp-law = no_such_module:Law")
    assert "sharp_law" in CONTROLLERS
    insertion = load_scenario("circle").insertion()
    with pytest.raises(
        PluginError,
        match=r"'sharp_law' in rcmqp.controllers, of the distribution "
        r"sharp 2.5: cannot be loaded from no_such_module:Law: ModuleNotFoundError",
    ):
        make_controller("sharp-law", insertion, 0.01)


def test_a_name_of_two_distributions_is_neithers(installed: Path) -> None:
    for name in ("left", "right"):
        install(installed, name, "rcmqp.paths", f"nod = {name}:Nod")
    with pytest.raises(PluginError, match=r"(left 2.5 and right|right 2.5 and left) 2.5: .*both"):
        _ = PATHS["nod"]


@pytest.mark.parametrize("value", ["math:pi", "fractions:Fraction", "rcmqp:Camera"])
def test_a_controller_that_is_none_is_refused(installed: Path, value: str) -> None:
    install(installed, "odd", "rcmqp.controllers", f"odd = {value}")
    with pytest.raises(PluginError, match=r"odd 2.5: .* must be a dataclass derived from Contr"):
        _ = CONTROLLERS["odd"]


def test_an_arm_without_a_robot_toml_is_refused(installed: Path) -> None:
    install(installed, "legs", "rcmqp.arms", "legs = json")
    with pytest.raises(PluginError, match=r"legs 2.5: .*a package with a robot.toml"):
        load_arm("legs")


def test_a_scenario_without_its_function_is_refused(installed: Path) -> None:
    install(installed, "plot", "rcmqp.scenarios", "plot = json")
    with pytest.raises(OptionError, match=r"plot of plot 2.5 has no function scenario"):
        scenario_module("plot")


def test_lists_leave_out_what_cannot_be_loaded_and_say_so(
    installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for group in ("arms", "scenarios", "controllers"):
        install(installed, f"bad_{group}", f"rcmqp.{group}", "bad = no_such_module:Thing")
        with pytest.raises(SystemExit) as ended:
            main([group])
        printed = capsys.readouterr()
        assert ended.value.code == 0
        assert f"bad-{group} 2.5" in " ".join(printed.err.split()).replace("_", "-")
        assert "bad" not in printed.out


def test_rcmqps_own_names_hide_those_of_plug_ins(installed: Path) -> None:
    install(installed, "thief", "rcmqp.controllers", "dual_quaternion = no_such_module:Law")
    assert CONTROLLERS["dual_quaternion"] is DualQuaternion
    assert list(CONTROLLERS).count("dual_quaternion") == 1
    assert len(CONTROLLERS) == len(list(CONTROLLERS))


def test_a_class_of_a_broken_packages_neighbour_is_found(installed: Path) -> None:
    """The package's first entry point cannot be loaded, its second is the class."""
    (installed / "pair.py").write_text(
        "from rcmqp.references.paths import Circle\nclass Own(Circle):\n    __slots__ = ()\n"
    )
    install(installed, "pair", "rcmqp.paths", "broken = pair:Gone\nown = pair:Own")
    import pair  # type: ignore[import-not-found]

    try:
        assert PATHS.name_of(pair.Own) == "own"
        assert PATHS.name_of(int) is None
    finally:
        del sys.modules["pair"]


def test_names_that_nobody_has_stay_unknown() -> None:
    with pytest.raises(UnknownName, match="unknown arm 'benchtop'"):
        load_arm("benchtop")


def test_importing_rcmqp_and_loading_its_own_arms_looks_for_no_plug_in() -> None:
    code = (
        "import rcmqp, rcmqp.cli; from rcmqp.world.plugins import _points; "
        "rcmqp.load_arm('lwa3'); print(_points.cache_info().currsize)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "0\n"
