from __future__ import annotations

import importlib.metadata
import importlib.resources
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import rcmqp

ROOT = Path(__file__).parents[1]
HEAVY = {  # each takes long to import, and neither importing rcmqp nor its help needs it
    "daqp",
    "h5py",
    "joblib",
    "matplotlib",
    "meshcat",
    "proxsuite",
    "qpsolvers",
    "rich.progress",
    "scipy",
}


@pytest.mark.parametrize("name", rcmqp.__all__)
def test_every_public_name_resolves(name: str) -> None:
    assert getattr(rcmqp, name) is not None


def test_public_names_are_sorted_and_listed_once() -> None:
    assert rcmqp.__all__ == sorted(set(rcmqp.__all__))


def test_version_is_that_of_the_distribution() -> None:
    assert rcmqp.__version__ == importlib.metadata.version("rcmqp")


def test_package_is_typed() -> None:
    assert (importlib.resources.files("rcmqp") / "py.typed").is_file()


@pytest.mark.parametrize("line", ["import rcmqp", "from rcmqp.cli import main; main(['--help'])"])
def test_import_and_help_load_nothing_heavy(line: str) -> None:
    loaded = f"print('loaded', sorted({HEAVY} & set(sys.modules)))"
    code = f"import atexit, sys; atexit.register(lambda: {loaded}); {line}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded []"


def test_the_wheel_has_every_module_and_what_they_read(tmp_path: Path) -> None:
    pytest.importorskip("setuptools", minversion="77")  # as pyproject.toml has it, no network
    source = tmp_path / "source"
    no_links = shutil.ignore_patterns("__pycache__", "*.so", "robots", "scenarios")
    shutil.copytree(ROOT / "rcmqp", source / "rcmqp", ignore=no_links)
    for folder in ("robots", "scenarios"):
        shutil.copytree(ROOT / folder, source / folder, ignore=no_links)
    for name in ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    setup = (
        (ROOT / "setup.py").read_text(encoding="utf-8").replace("-O3", "-O0")
    )  # compiles sooner
    (source / "setup.py").write_text(setup, encoding="utf-8")
    command = [sys.executable, "-m", "pip", "wheel", "--disable-pip-version-check", "--no-deps"]
    command += ["--no-build-isolation", "--no-index", "--wheel-dir", str(tmp_path), str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert not done.returncode, f"{done.stdout}{done.stderr}"
    with zipfile.ZipFile(next(tmp_path.glob("rcmqp-*.whl"))) as wheel:
        found = {name for name in wheel.namelist() if "dist-info" not in name}
    there = {file for file in (ROOT / "rcmqp").rglob("*") if file.is_file()}
    wanted = {file.relative_to(ROOT).as_posix() for file in there if file.suffix != ".so"}
    for folder in ("robots", "scenarios"):
        files = {
            file for end in ("py", "toml", "urdf") for file in ROOT.glob(f"{folder}/**/*.{end}")
        }
        wanted |= {f"rcmqp/{file.relative_to(ROOT).as_posix()}" for file in files}
    wanted = {name for name in wanted if "__pycache__" not in name}
    assert len([name for name in found if name.endswith(".py")]) > 150
    assert wanted <= found
    assert all(name.startswith("rcmqp/_kernel.") for name in found - wanted)
