from __future__ import annotations

import importlib.metadata
import importlib.resources
import subprocess
import sys

import pytest

import rcmqp

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
