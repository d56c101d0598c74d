"""Colours that tell runs apart, in figures and on the page."""

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
