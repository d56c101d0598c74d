"""Colours of runs and of the camera task's spheres, in figures and on the page."""

from __future__ import annotations

COLOURS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#9048F0",
    "#8B5A2B",
)
"""Six of Okabe and Ito's, and a violet and a brown that are no nearer to them for the
colour-blind; one a run, as many as there are controllers."""

DASHES = ("solid", "dashed", "dashdot", "dotted")
"""Of lines over time."""


def colour(run: int) -> str:
    """Of the run in that place."""
    return COLOURS[run % len(COLOURS)]


def dash(run: int) -> str:
    """Of the run in that place; it is another where colours come again."""
    return DASHES[(run + run // len(COLOURS)) % len(DASHES)]


SPHERES = ((0.84, 0.37, 0.0), (0.94, 0.89, 0.26), (0.0, 0.62, 0.45), (0.0, 0.45, 0.70))
"""Of the camera task's objectives, in their order, red, green, blue from 0 to 1: four of Okabe
and Ito's."""
