"""A camera task that ends soon, and studies of it."""

from __future__ import annotations

from rcmqp.experiments.study.plan import Law, Study

SHORT = """
import dataclasses
from rcmqp import load_scenario

def scenario(arm="panda", *, flange=None):
    return dataclasses.replace(load_scenario("camera_task", arm), duration={duration})
"""
SLOW = Law(period=0.02)


def study(scenario: str, operators: int = 4, **changes: object) -> Study:
    return Study(scenario, operators, laws=(SLOW,), **changes)  # type: ignore[arg-type]
