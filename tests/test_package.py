from __future__ import annotations

import ast
import importlib
import importlib.metadata
import importlib.resources
import pkgutil
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import rcmqp

ROOT = Path(__file__).parents[1]
MOST_NAMES = 50
"""Of rcmqp itself: what a newcomer meets."""

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


def test_public_names_are_listed_once() -> None:
    assert len(set(rcmqp.__all__)) == len(rcmqp.__all__)


def test_rcmqp_exports_what_its_readers_are_shown() -> None:
    """Programs of the README and of the guides import from ``rcmqp`` itself."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    shown = set()
    for page in pages:
        programs = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
        for node in (node for text in programs for node in ast.walk(ast.parse(text))):
            if isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] == "rcmqp":
                assert node.module == "rcmqp", f"{page.name}: from {node.module} import ..."
                shown |= {name.name for name in node.names}
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "rcmqp":
                shown.add(node.attr)
    print(f"{len(rcmqp.__all__)} names, {len(shown)} of them shown")
    assert len(shown) > 25
    assert shown <= {*rcmqp.__all__, "__version__"}
    assert len(rcmqp.__all__) <= MOST_NAMES


def test_each_modules_name_is_the_module() -> None:
    """No function or class stands in the place of a module of its name."""
    for found in pkgutil.walk_packages(rcmqp.__path__, "rcmqp."):
        if found.name == "rcmqp.__main__":
            continue
        module = importlib.import_module(found.name)
        folder, _, name = found.name.rpartition(".")
        assert getattr(importlib.import_module(folder), name) is module, found.name


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
