"""The console's page: the viewer's modules, the arm, and what stands around it."""

from __future__ import annotations

import dataclasses
import html
from string import Template
from typing import Any

from rcmqp.controllers import make_controller
from rcmqp.runs.scenario import Scenario
from rcmqp.runs.simulate import simulate
from rcmqp.show.viewer.build import asset, framed, library, page_data
from rcmqp.show.viewer.bundle import bundled
from rcmqp.world.loading import arm_title


def page(scenario: Scenario, controller: str, options: dict[str, Any]) -> str:
    """The page of a scenario whose arm is at its start; it needs no other file.

    Args:
        scenario: arm, trocar, and what there is to be seen.
        controller: its name.
        options: of the controller.
    """
    short = dataclasses.replace(scenario, duration=scenario.period)
    insertion = short.insertion()
    made = make_controller(controller, insertion, short.period, **options)
    start = simulate(short, made)
    deepest = min(scenario.instrument.length, scenario.trocar.depth_range[1])
    title = f"{scenario.name} on {arm_title(scenario.arm)}, live"
    body = Template(asset("live.html")).substitute(
        title=html.escape(title),
        subtitle=html.escape(controller),
        meshcat=library("meshcat", "viewer/dist/main.min.js"),
        data=page_data([start], ["arm"], insertion, deepest=deepest),
        script=bundled("live.js", asset),
    )
    return framed(title, asset("page.css") + asset("live.css"), body)
