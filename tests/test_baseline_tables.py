"""docs/controllers.md shows what benchmarks/baselines.py prints."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from rcmqp.controllers import CONTROLLERS

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
TABLES = runpy.run_path(str(ROOT / "benchmarks" / "baselines.py"))


@pytest.mark.parametrize("table", ["laws_table", "held_table", "planner_table"])
def test_the_tables_of_the_page_are_those_that_the_benchmark_prints(table: str) -> None:
    assert TABLES[table]() in PAGE


def test_the_page_has_every_published_controller_and_the_benchmark_runs_each() -> None:
    ours = {"dual_quaternion", "hierarchical_qp", "weighted_qp"}
    published = CONTROLLERS.keys() - ours
    assert {name for name, _ in TABLES["LAWS"]} == published
    for name in published:
        assert f"| `{name}`" in PAGE
        assert "Read: " in (CONTROLLERS[name].__doc__ or "") or name == "task_reconstruction"
