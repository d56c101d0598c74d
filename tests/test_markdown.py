"""What is literal in Markdown, against a renderer of it."""

from __future__ import annotations

import html
import re
import string

import numpy as np
from markdown_it import MarkdownIt

from rcmqp.show.table import literal


def test_names_are_shown_as_they_are_in_headings_cells_and_captions() -> None:
    rng = np.random.default_rng(7)
    signs = [*string.punctuation, *"`*_[]()!<>&#~|\\", *"aé1", " "]
    texts = ["".join(rng.choice(signs, 12)) for _ in range(2000)]
    texts += [
        "![a](b)",
        "~~a~~",
        "[a](b)",
        "**a**",
        "_a_",
        "<http://a.b>",
        "&amp;",
        "a | b",
        "`a`",
        "a ##",
    ]
    render = MarkdownIt("commonmark", {"html": False}).enable(["table", "strikethrough"]).render
    for text in texts:
        shown = " ".join(text.split())
        inside = literal(text)
        page = render(f"## a {inside}\n\n| a |\n| --- |\n| a {inside} |\n\n![a {inside}](b.png)\n")
        found = re.findall(r'<(?:h2|td)>(.*)</(?:h2|td)>|<img src="b.png" alt="(.*)" />', page)
        assert [html.unescape(one or other) for one, other in found] == [f"a {shown}"] * 3


def test_names_of_controllers_and_their_numbers_stay_legible() -> None:
    text = "dual_quaternion, K_c = 7.0, T = 8 ms (run 2): -1e-3, at 50 %"
    assert literal(text) == text
