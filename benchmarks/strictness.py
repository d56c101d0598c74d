"""hierarchical_qp at 10,000 random states of four arms, against an independent exact solution.

    python benchmarks/strictness.py

Each state is anywhere inside the joint limits, half of them with limits of acceleration on top
of those of position and speed; the view is from 1 mm to a third of a metre away. The joint speeds,
and each level's residual, are compared with those of the damped hierarchy solved level by level
with scipy's non-negative least squares in nullspaces, each level's optimum proved by multipliers
found likewise (``tests/oracle.py``). ``tests/test_strictness.py`` does the same with fewer states.
"RCM alone" counts states in which only the RCM is compared, see ``tests/arm_states.py``;
"undecided" those in which the oracle cannot prove its own answer, which are not compared.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from arm_states import ARMS, LEVELS, Verdict, verdict

from rcmqp.show.table import Table


def main() -> None:
    """Print a Markdown table, one line an arm; exit code 1 if a bound is not kept."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--states", type=int, default=10_000, help="in all")
    parser.add_argument("--jobs", type=int, default=-1, help="processes; -1 for every core")
    given = parser.parse_args()
    start, each = time.perf_counter(), given.states // len(ARMS)
    chunks = Parallel(n_jobs=given.jobs)(
        delayed(several)(arm, range(first, min(first + 50, each)))
        for arm in ARMS
        for first in range(0, each, 50)
    )
    found: dict[str, list[Verdict]] = {arm: [] for arm in ARMS}
    for arm, verdicts in chunks:
        found[arm] += verdicts
    heads = ["arm", "states", "at a bound", "RCM reached", "joints", *LEVELS]
    heads += ["RCM alone", "undecided", "KKT", "failures"]
    everything = [each for verdicts in found.values() for each in verdicts]
    rows = [[arm, *cells(verdicts)] for arm, verdicts in [*found.items(), ("all", everything)]]
    print(Table(heads, rows).markdown(), end="")
    print(f"\n{time.perf_counter() - start:.0f} s; differences and proofs in m/s and rad/s")
    sys.exit(not all(map(kept, everything)))


def several(arm: str, seeds: range) -> tuple[str, list[Verdict]]:
    """Verdicts on an arm, and its name."""
    return arm, [verdict(arm, seed) for seed in seeds]


def kept(one: Verdict) -> bool:
    """Whether a verdict is within what is promised."""
    near = max(one.apart, *one.differences) <= 1e-6
    return one.answered and (near or not one.decided) and one.kkt <= 1e-8


def cells(verdicts: list[Verdict]) -> list[str]:
    """A line of the table."""
    decided = [each for each in verdicts if each.decided]
    worst = np.max([[each.apart, *each.differences] for each in decided], axis=0)
    return [
        str(len(verdicts)),
        f"{np.mean([each.active for each in verdicts]):.0%}",
        f"{np.mean([each.reached for each in verdicts]):.0%}",
        *(f"{number:.0e}" for number in worst),
        str(sum(each.alone for each in verdicts)),
        str(len(verdicts) - len(decided)),
        f"{max(each.kkt for each in verdicts):.0e}",
        str(sum(not each.answered for each in verdicts)),
    ]


if __name__ == "__main__":
    main()
