"""Calls of every binding of the kernel with arguments that are wrong in every way.

    python benchmarks/fuzz.py --calls 100000  # a minute; make sanitize does it under sanitizers

Each call begins with arguments that are right, of which up to three are replaced: other types,
shapes, sizes, byte orders and strides, NaN, infinity and huge numbers, and objects whose
__float__, __index__, __bool__ or __array__ raises, calls the kernel again, or takes the memory
of the other arguments away. A call may answer, or raise anything but a SystemError. After every
call one with the right arguments must answer what it did at first, to the bit. Types are also made
without their constructor. Seeds are printed; the same seed does the same.
"""

from __future__ import annotations

import argparse
import collections
import copy
import functools
import pickle
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from fuzz_arguments import (
    Arguments,
    Pair,
    copies,
    cycle,
    given_rows,
    hostile,
    joints,
    right,
    right_block,
    right_stack,
)

from rcmqp import ArmState, Reference, _kernel
from rcmqp.show.table import Table
from rcmqp.tasks.objectives import OBJECTIVES

BATCH = 1000


def same(a: Any, b: Any) -> bool:
    """Whether two answers are the same to the bit."""
    if isinstance(a, np.ndarray):
        return bool(a.tobytes() == b.tobytes() and a.shape == b.shape)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, _kernel.Account):
        return same(a.numbers, b.numbers) and a.summary == b.summary
    if isinstance(a, Pair | ArmState | Reference):
        return all(same(getattr(a, name), getattr(b, name)) for name in type(a).__match_args__)
    return bool(a == b or (a != a and b != b))


class Fuzz:
    """Calls, counted.

    Attributes:
        counts: by binding, how many calls were answered and refused.
        wrong: what must not be.
    """

    def __init__(self) -> None:
        self.counts: collections.Counter[tuple[str, str]] = collections.Counter()
        self.wrong: list[str] = []

    def call(self, name: str, function: Callable[..., Any], *args: Any, **options: Any) -> Any:
        """One call; what it answers, or None."""
        try:
            answer = function(*args, **options)
        except SystemError as error:
            self.wrong.append(f"{name}: {error!r}")
        except Exception:  # noqa: BLE001  (a refusal, or what a hostile object raises)
            self.counts[name, "refused"] += 1
        else:
            self.counts[name, "answered"] += 1
            return answer
        return None

    def worse(self, rng: np.random.Generator, args: Arguments) -> Arguments:
        """The same arguments with up to three replaced, sometimes one more or less."""
        args = [*args]
        for _ in range(int(rng.choice([0, 1, 1, 1, 2, 3]))):
            at = int(rng.integers(len(args)))
            args[at] = hostile(rng, args[at], args)
        if rng.integers(20) == 0:
            args = args[:-1] if rng.integers(2) else [*args, None]
        return args

    def function(self, name: str, rng: np.random.Generator, seed: int) -> None:
        """A function of the module, wrongly and then rightly."""
        function = getattr(_kernel, name)
        first = function(*right(name, np.random.default_rng(seed)))
        self.call(name, function, *self.worse(rng, right(name, rng)))
        again = function(*right(name, np.random.default_rng(seed)))
        if not same(first, again):
            self.wrong.append(f"{name}: another answer after an error, seed {seed}")

    def block(self, rng: np.random.Generator) -> None:
        """A block, made and asked."""
        kind, options = right_block(rng)
        block = _kernel.Block(kind, **options)
        worse = copies(options)
        spoilt = min(len(options), int(rng.integers(3)))
        for key in rng.choice(sorted(options), spoilt, replace=False) if options else ():
            worse[key] = hostile(rng, worse[key], [*worse.values()])
        if rng.integers(8) == 0:
            worse["gian"] = 1.0
        made = self.call("Block", _kernel.Block, kind, **worse)
        n = block.joints or joints(rng)
        for asked in (block, made or block):
            self.call("Block.rows", asked.rows, *self.worse(rng, cycle(rng, n)))
            self.call("Block.goal", asked.goal, *self.worse(rng, [*cycle(rng, n), 60.0]))
            if kind in OBJECTIVES or rng.integers(9) == 0:
                args = self.worse(rng, [rng.normal(size=(6, n)), rng.normal(size=n)])
                self.call("Block.value", asked.value, *args)
            if kind == "joints" or rng.integers(9) == 0:
                args = self.worse(rng, [*rng.normal(size=(3, n))])
                self.call("Block.interval", asked.interval, *args)

    def stack(self, rng: np.random.Generator) -> None:
        """A stack, made and stepped; by a backend, too; accounts are asked for at any time."""
        n, options = right_stack(rng)
        worse = copies(options)
        for key in rng.choice(sorted(options), int(rng.integers(3)), replace=False):
            worse[key] = hostile(rng, worse[key], [*worse.values()])
        made = self.call("Stack", _kernel.Stack, **worse)
        stack: Any = _kernel.Stack(**options)
        state = cycle(rng, n), given_rows(rng, n)
        kept = collections.deque[Any](maxlen=3)

        def backend(level: int, M: Any, c: Any, R: Any, *bounds: Any) -> Any:
            if rng.integers(4) == 0:
                stack.step(*state[0], state[1], None)
            if kept and kept[0] is not None and rng.integers(2):
                self.call("Account", lambda: kept[0][1].numbers.sum())
            return (
                hostile(rng, np.zeros(len(R)), [*state[0]])
                if rng.integers(2)
                else np.sign(R[:, 0])
            )

        stack.reset()
        first = stack.step(*copy.deepcopy(state[0]), state[1], None)
        for asked in (stack, made or stack):
            args = self.worse(rng, [*cycle(rng, n), given_rows(rng, n), None])
            kept.append(self.call("Stack.step", asked.step, *args))
            args = [*cycle(rng, n), given_rows(rng, n), backend]
            kept.append(self.call("Stack.step, backend", asked.step, *args))
            args = self.worse(rng, [*cycle(rng, n), given_rows(rng, n)])
            self.call("Stack.problem", asked.problem, *args)
            self.call("Account", setattr, first[1], "numbers", None)
        stack.reset()
        again = stack.step(*state[0], state[1], None)
        if not same(first, again):
            self.wrong.append("Stack.step: another answer after an error")

    def without_constructor(self) -> None:
        """Types of the kernel, made behind its back: each must be refused."""
        rng = np.random.default_rng(1)
        block, stack = _kernel.Block("tip"), _kernel.Stack(**right_stack(rng)[1])
        account = _kernel.solve(*right("solve", rng))[1]
        array = type("A", (np.ndarray,), {"__match_args__": ()})
        doors: list[Callable[[], Any]] = []
        each: Any
        for each in (block, stack, account):
            kind: Any = type(each)
            doors += [
                functools.partial(object.__new__, kind),
                functools.partial(kind.__new__, kind),
                functools.partial(copy.copy, each),
                functools.partial(copy.deepcopy, each),
                functools.partial(pickle.dumps, each),
                functools.partial(_kernel.record, kind),
                functools.partial(type, "Derived", (kind,), {}),
                kind,
            ]
        for each in (block, stack):
            doors += [
                functools.partial(how, each) for how in (copy.copy, copy.deepcopy, pickle.dumps)
            ]
        other: Any = type("O", (), {"__slots__": tuple(f"s{i}" for i in range(40))})
        stolen = type("T", (), {"__slots__": ("x",), "__match_args__": ("a",), "a": other.s39})
        doors += [functools.partial(_kernel.record, array)]
        doors += [functools.partial(_kernel.record, stolen, 1)]  # would be written outside of it
        for door in doors:
            if (made := self.call("no constructor", door)) is not None:
                self.wrong.append(f"made without a constructor: {type(made).__name__}, {door}")


FUNCTIONS = (
    "law", "solve", "usable", "frozen", "record", "state", "moved", "all_finite", "paced",
    "least_singular_values", "in_order", "manipulability", "from_xyzquat", "carried", "view_pose",
    "approach", "store", "views", "view_poses", "observed", "contour",
)  # fmt: skip


def main() -> None:
    """Print a table of the calls; exit code 1 if one was answered as it must not be."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--calls", type=int, default=100_000, help="in all, at least")
    parser.add_argument("--seed", type=int, default=0, help="of the first batch")
    given = parser.parse_args()
    np.seterr(all="ignore")
    fuzz, seed = Fuzz(), given.seed
    fuzz.without_constructor()
    while fuzz.counts.total() < given.calls and not fuzz.wrong:
        print(f"seed {seed}, {fuzz.counts.total()} calls", file=sys.stderr, flush=True)
        rng, end = np.random.default_rng(seed), fuzz.counts.total() + BATCH
        while fuzz.counts.total() < end:
            for name in FUNCTIONS:
                fuzz.function(name, rng, seed)
            fuzz.block(rng)
            fuzz.stack(rng)
        seed += 1
    names = sorted({name for name, _ in fuzz.counts})
    rows = [[n, *(str(fuzz.counts[n, how]) for how in ("answered", "refused"))] for n in names]
    print(Table(["binding", "answered", "refused"], rows).markdown(), end="")
    print(f"\n{fuzz.counts.total()} calls, seeds {given.seed} to {seed - 1}")
    print(*fuzz.wrong, sep="\n")
    sys.exit(bool(fuzz.wrong))


if __name__ == "__main__":
    main()
