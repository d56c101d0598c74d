"""Write docs/measures.md: every measure with its title, unit and meaning, from the vocabulary.

``python benchmarks/measures_page.py``; `make tables` does it too.
"""

from __future__ import annotations

from pathlib import Path

from rcmqp.experiments.study.vocabulary import HANDS, TRIALS
from rcmqp.runs.vocabulary import MEASURES
from rcmqp.show.table import Table

PAGE = Path(__file__).parents[1] / "docs" / "measures.md"

TEXT = """\
# Measures

What the columns and rows of every table mean, by their names in CSV and JSON. Tables, pages and
the terminal take their words from the same place, `rcmqp/runs/vocabulary.py`; `python
benchmarks/measures_page.py` writes this page.

## Runs

{runs}
## Trials of a study, beside those of their runs

{trials}
## Hands, of `rcmqp hands`

{hands}"""


def page() -> str:
    """The page's text."""
    trials = {name: each for name, each in TRIALS.items() if name not in MEASURES}
    groups = {"runs": MEASURES, "trials": trials, "hands": HANDS}
    return TEXT.format(
        **{
            group: Table(
                ["name", "column", "row", "unit", "meaning"],
                [
                    [each.name, each.head, each.label, each.unit, each.meaning]
                    for each in of.values()
                ],
                words=5,
            ).markdown()
            for group, of in groups.items()
        }
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"wrote {PAGE}")
