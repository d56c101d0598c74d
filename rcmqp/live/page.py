"""The console's page: the viewer's modules, the arm, and what stands around it."""

from __future__ import annotations

import dataclasses
import html
import json
from string import Template
from typing import Any

from rcmqp.controllers import make_controller
from rcmqp.references.paths import Search
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import simulate
from rcmqp.show.viewer.build import asset, framed, library, page_data
from rcmqp.show.viewer.bundle import bundled
from rcmqp.show.viewer.scene import views
from rcmqp.world.insertion import Insertion
from rcmqp.world.loading import arm_title


def page(scenario: Scenario, controller: str, options: dict[str, Any]) -> str:
    """The console's page of a scenario whose arm is at its start; it needs no other file.

    Args:
        scenario: arm, trocar, and what there is to be seen.
        controller: its name.
        options: of the controller.
    """
    title = f"{scenario.name} on {arm_title(scenario.arm)}, live"
    return _page(title, controller, start_data(scenario, controller, options), None)


def task_page(data: str, words: dict[str, Any]) -> str:
    """The page of a task or practice.

    Args:
        data: see start_data().
        words: title, instructions, seconds, note, and those of task_words(); see task.js.
    """
    return _page(words["title"], "", data, words)


def start_data(scenario: Scenario, controller: str, options: dict[str, Any]) -> str:
    """The arm at its start and all around it, as a page has it; it takes some seconds to make."""
    short = dataclasses.replace(scenario, duration=scenario.period)
    insertion = short.insertion()
    start = simulate(short, make_controller(controller, insertion, short.period, **options))
    deepest = min(scenario.instrument.length, scenario.trocar.depth_range[1])
    return page_data([start], ["arm"], insertion, deepest=deepest)


def _page(title: str, subtitle: str, data: str, task: dict[str, Any] | None) -> str:
    body = Template(asset("live.html")).substitute(
        title=html.escape(title),
        subtitle=html.escape(subtitle),
        meshcat=library("meshcat", "viewer/dist/main.min.js"),
        data=data,
        task=json.dumps(task).replace("<", "\\u003c"),
        script=bundled("live.js", asset),
    )
    return framed(title, asset("page.css") + asset("live.css") + asset("task.css"), body)


def task_words(task: Search, insertion: Insertion) -> dict[str, Any]:
    """What the page of a task needs to know of it."""
    return {"views": views(task.places, insertion), "instructions": task.instructions}
