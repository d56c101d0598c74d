from __future__ import annotations

import ast
import importlib.metadata
import importlib.resources
import re
import subprocess
import sys
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


def test_imports_go_down_the_list_in_contributing() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.findall(r"`(\w+)/?`", re.split("Imports go down|Only", text)[1])
    order = [*listed, "__init__", "__main__"]
    imports: dict[tuple[str, str], Path] = {}
    for file in (ROOT / "rcmqp").rglob("*.py"):
        part = file.relative_to(ROOT / "rcmqp").parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rcmqp"):
                names = [f"{node.module}.{name.name}" for name in node.names]
                imports |= {(part, name.split(".")[1]): file for name in names}
    assert {part for part, _ in imports} <= set(order)
    assert len(imports) > 100
    up = [
        f"{file.name} imports {name}"
        for (part, name), file in imports.items()
        if name in order and order.index(name) > order.index(part)
    ]
    assert not up
