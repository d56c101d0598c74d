"""One table in five ways, with contents that each of them could take for its own signs."""

from __future__ import annotations

import csv
import html
import io
import math
import re
from html.parser import HTMLParser

import pytest
from markdown_it import MarkdownIt
from pylatexenc.latexwalker import LatexEnvironmentNode, LatexWalker, LatexWalkerParseError
from rich.console import Console

from rcmqp.show.table import Table, definitions_html

LONG = "a_name_" * 40
CELLS = (
    "a | b",
    "two\nlines",
    'R&D "100 %" _x_ #1 $5 {x} ~ ^ \\ \\end{tabular}',
    "[0.1, 0.3] ± 0.2 µm",
    "* starred",
    "<b>bold</b> <script>",
    "[link](http://a.b) ![x](y) `code`",
    "--- \u2020",
    "no limit",
    "",
    LONG,
)
TABLE = Table(
    ["name", "tip rms [mm]", "acc. / limit"],
    [[cell, 0.25, cell] for cell in CELLS],
    title="Errors: 100 % & more",
)
SHOWN = [" ".join(cell.split()) for cell in CELLS]


class Cells(HTMLParser):
    """The texts of a page's table cells, and every element in it."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.texts, self.elements, self._inside = list[str](), set[str](), False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.elements.add(tag)
        self._inside = tag == "td"
        if self._inside:
            self.texts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.texts[-1] += data


def flat(cells: list[str]) -> list[str]:
    return [text for cell in cells for text in (cell, "0.25", cell)]


def test_markdown_shows_every_cell_as_it_is() -> None:
    page = MarkdownIt("commonmark", {"html": False}).enable("table").render(TABLE.markdown())
    found = Cells(page)
    assert found.texts == flat(SHOWN)
    assert found.elements <= {"p", "table", "thead", "tbody", "tr", "th", "td"}
    assert "<p>Errors: 100 % &amp; more</p>" in page
    assert "| tip rms [mm] | acc. / limit |\n| --- | ---: | ---: |\n" in TABLE.markdown()


def test_units_intervals_and_small_numbers_stay_legible_in_markdown() -> None:
    cells = ["< 0.05", "0.1 ± 0.2 [0.1, 0.3]", "tip [mm/s^2]", "K_c"]
    assert f"| {' | '.join(cells)} |\n" in Table(cells, [cells], words=4).markdown()


def test_html_shows_every_cell_as_it_is_and_holds_no_foreign_element() -> None:
    page = TABLE.html(['<i class="run"></i>'])
    found = Cells(page)
    assert found.texts == flat(list(CELLS))
    marks = {"i", "span"}
    assert found.elements <= {"table", "caption", "thead", "tbody", "tr", "th", "td"} | marks
    assert '<i class="run"></i>tip rms [mm]' in page
    assert definitions_html({"<a>": "b & c"}).count("&lt;a&gt;</dt><dd>b &amp; c") == 1


def test_csv_holds_values_at_full_precision_and_no_formula() -> None:
    third = 1.0 / 3.0
    cells = [third, math.nan, None, True, 'a,\n"b"', "=HYPERLINK(1)", "+a", "-1.5e-3", "@x"]
    table = Table(["=head", *map(str, range(8))], [cells])
    heads, row = csv.reader(io.StringIO(table.csv()))
    assert heads[0] == "'=head"
    assert float(row[0]) == third
    assert row[1:5] == ["nan", "", "True", 'a,\n"b"']
    assert row[5:] == ["'=HYPERLINK(1)", "'+a", "-1.5e-3", "'@x"]


def test_missing_values_are_empty_cells_and_short_rows_are_filled() -> None:
    table = Table(["a", "b", "c"], [[None, math.nan], [math.inf, -0.5, 2]])
    assert table.texts == [["", "", ""], ["inf", "-0.5", "2"]]
    assert table.markdown().splitlines()[2] == "|  |  |  |"
    assert [len(row) for row in csv.reader(io.StringIO(table.csv()))] == [3, 3, 3]


def unescaped(cell: str) -> str:
    """What LaTeX shows of a cell; fails on a sign that LaTeX would take for its own."""
    named = {
        "textbackslash": "\\",
        "textasciitilde": "~",
        "textasciicircum": "^",
        "textless": "<",
        "textgreater": ">",
        "textbar": "|",
        "char34": '"',
        "textasciigrave": "`",
        "textpm": "±",
        "textmu": "µ",
        "textdagger": "\u2020",
        "textdaggerdbl": "\u2021",
    }
    known = r"\\([&%$#_{}])|\{([\[\]*-])\}|\\(" + "|".join(named) + r")\{\}"
    assert not re.search(r"[\\&%$#_{}~^]", re.sub(known, "", cell)), cell
    return re.sub(known, lambda m: m[1] or m[2] or named[m[3]], cell)


def test_latex_is_booktabs_whose_cells_show_what_they_hold() -> None:
    lines = TABLE.latex().splitlines()
    assert lines[:6] == [
        r"\begin{table}",
        r"\caption{Errors: 100 \% \& more}",
        r"\centering",
        r"\begin{tabular}{@{}lrr@{}}",
        r"\toprule",
        r"name & tip rms {[}mm{]} & acc. / limit \\",
    ]
    assert lines[6] == r"\midrule"
    assert lines[-3:] == [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
    rows = lines[7:-3]
    assert all(row.endswith(r" \\") for row in rows)
    assert not any(row.startswith(("[", "*")) for row in rows)  # of the line end's own
    found = [[unescaped(c) for c in row.removesuffix(r" \\").split(" & ")] for row in rows]
    assert found == [[cell, "0.25", cell] for cell in SHOWN]


def parsed(text: str) -> list[LatexEnvironmentNode]:
    """The environments at the top of a LaTeX text; an error where it does not parse."""
    nodes, _, _ = LatexWalker(text, tolerant_parsing=False).get_latex_nodes()
    return [node for node in nodes if node.isNodeType(LatexEnvironmentNode)]


def test_latex_parses_to_a_table_whose_rows_have_a_cell_for_each_head() -> None:
    (table,) = parsed(TABLE.latex())
    assert table.environmentname == "table"
    (inside,) = (node for node in table.nodelist if node.isNodeType(LatexEnvironmentNode))
    assert inside.environmentname == "tabular"
    ends = [node.latex_verbatim().rstrip() for node in inside.nodelist]
    assert ends.count("\\\\") == 1 + len(CELLS)
    assert ends.count("&") == (1 + len(CELLS)) * (len(TABLE.heads) - 1)
    with pytest.raises(LatexWalkerParseError):
        parsed(TABLE.latex().replace("{[}", "{[", 1))


def printed(table: Table, width: int) -> str:
    stream = io.StringIO()
    Console(file=stream, width=width).print(table)
    return stream.getvalue()


def test_the_terminal_shows_texts_as_they_are_and_runs_no_escape() -> None:
    text = printed(Table(["[red]a[/]", "b"], [["[bold]x", "\x1b[2J"], ["a | b", math.nan]]), 80)
    assert "[red]a[/]" in text
    assert "[bold]x" in text
    assert r"\x1b[2J" in text
    assert "\x1b" not in text
    assert "nan" not in text


def test_a_table_too_wide_for_the_terminal_breaks_at_spaces() -> None:
    heads = ["name", *["joint-limits enforced by scaling"] * 4]
    table = Table(heads, [["controller", *["speed by scaling"] * 4]])
    assert "speed by scaling" in printed(table, 200)
    text = printed(table, 70)
    assert max(map(len, text.splitlines())) <= 70
    assert {"enforced", "scaling", "controller"} <= set(text.split())
    assert LONG in printed(Table(["name", "b"], [[LONG, "1"]]), 320).replace("\n", "")


def test_html_is_escaped_once() -> None:
    assert html.unescape(Table(["&lt;"], [["&amp;"]]).html()).count("&amp;") == 1
