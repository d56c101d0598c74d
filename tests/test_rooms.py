"""The package is rooms, and imports between them go one way: down the list in CONTRIBUTING.md."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "rcmqp"
ORDER = (
    "errors",
    "files",
    "kernel",
    "maths",
    "world",
    "references",
    "qp",
    "tasks",
    "limits",
    "controllers",
    "plants",
    "runs",
    "show",
    "realtime",
    "drivers",
    "experiments",
    "live",
    "cli",
)
"""Rooms, the ground floor first; a room may import those before it."""

DOORS = ("__init__.py", "__main__.py", "_kernel.pyi", "py.typed")
"""What makes the folder a package; no rooms."""

DATA = ("robots", "scenarios")
"""Packages of their own, which may be linked into the folder."""

MOST_ENTRIES, MOST_ARROWS = 18, 80

Arrow = tuple[str, str]


def entries() -> set[str]:
    """What is at the package's root, but for what is made there and what makes it a package."""
    made = ("__pycache__", *DOORS, *DATA)
    return {
        path.name
        for path in PACKAGE.iterdir()
        if path.name not in made and path.suffix not in (".so", ".pyd") and path.name[0] != "."
    }


def imported(tree: ast.AST) -> Iterator[str]:
    """Modules, or names in them, of rcmqp that a module imports, anywhere in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "a relative import"
            yield from (f"{node.module}.{name.name}" for name in node.names)


def arrows() -> dict[Arrow, list[str]]:
    """Which room imports which, and where; the compiled module is the room of its sources."""
    found: dict[Arrow, list[str]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        here = file.relative_to(PACKAGE)
        room = here.parts[0].removesuffix(".py")
        if room in (*DATA, "__init__", "__main__"):
            continue
        for name in imported(ast.parse(file.read_text(encoding="utf-8"))):
            if name.startswith("rcmqp."):
                other = name.split(".")[1].replace("_kernel", "kernel")
                if other != room:
                    found.setdefault((room, other), []).append(f"{here} imports {name}")
    return found


def test_the_root_has_rooms_only() -> None:
    found = entries()
    print(f"{len(found)} entries: {', '.join(sorted(found))}")
    assert len(found) <= MOST_ENTRIES
    assert {name.removesuffix(".py") for name in found} <= set(ORDER)


def test_imports_between_rooms_go_down_and_are_few() -> None:
    found = arrows()
    print(f"{len(found)} arrows")
    for room in ORDER:
        print(f"{room}: {', '.join(x for x in ORDER if (room, x) in found) or 'nothing'}")
    rooms = {room for arrow in found for room in arrow}
    assert rooms <= set(ORDER)
    assert rooms >= {name.removesuffix(".py") for name in entries()}
    assert len(found) <= MOST_ARROWS
    up = [
        where
        for (room, other), places in found.items()
        if ORDER.index(other) > ORDER.index(room)
        for where in places
    ]
    assert not up  # so there is no circle either


def test_the_root_is_imported_for_its_version_only() -> None:
    for file in PACKAGE.rglob("*.py"):
        if (room := file.relative_to(PACKAGE).parts[0]) in DATA:
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        used = {
            node.attr
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "rcmqp"
        }
        assert used <= {"__version__"}, f"{room}: {file.name}"


def test_people_do_not_leak() -> None:
    """What is to be seen on a path, and whether somebody steers, is asked of the path."""
    asking = re.compile(r"isinstance\([^()]*\bCameraTrial\b")
    files = [file for file in PACKAGE.rglob("*.py") if asking.search(file.read_text("utf-8"))]
    assert {file.parent.name for file in files} == {"operators"}


def test_contributing_has_the_rooms_in_their_order() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    listed = re.findall(r"^- `(\w+)(?:\.py|/)`", text, re.MULTILINE)
    there = {name.removesuffix(".py") for name in entries()}
    assert listed == [room for room in ORDER if room in there]
