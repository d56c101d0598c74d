"""docs/controllers.md shows what benchmarks/baselines.py prints."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from rcmqp.controllers import CONTROLLERS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
TABLES = runpy.run_path(str(ROOT / "benchmarks" / "baselines.py"))


CHAOTIC = "vfi_qp"
"""Joints at their speed limits jump between two answers from cycle to cycle: rounding alone, 1e-14
of an option, changes its counts by a fifth."""


def same(shown: str, printed: str) -> bool:
    """Whether two rows are one; of the law that is chaotic, whether the numbers are near."""
    if CHAOTIC not in printed:
        return shown == printed
    pairs = list(zip(shown.split("|"), printed.split("|"), strict=True))
    return all(a == b or float(a) == pytest.approx(float(b), rel=0.3) for a, b in pairs)


@pytest.mark.parametrize("table", ["laws_table", "held_table", "planner_table"])
def test_the_tables_of_the_page_are_those_that_the_benchmark_prints(table: str) -> None:
    printed = TABLES[table]().splitlines()
    lines = PAGE.splitlines()
    first = lines.index(printed[0])
    shown = lines[first : first + len(printed)]
    assert [(a, b) for a, b in zip(shown, printed, strict=True) if not same(a, b)] == []


def test_the_page_has_every_published_controller_and_the_benchmark_runs_each() -> None:
    ours = {"dual_quaternion", "hierarchical_qp", "weighted_qp"}
    published = CONTROLLERS.keys() - ours
    assert {name for name, _ in TABLES["LAWS"]} == published
    for name in published:
        assert f"| `{name}`" in PAGE
        assert "Read: " in (CONTROLLERS[name].__doc__ or "") or name == "task_reconstruction"
