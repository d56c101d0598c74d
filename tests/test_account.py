"""The account of a step is made when it is asked for, and is the same whenever that is."""

from __future__ import annotations

import copy
import dataclasses
import gc
import threading
from typing import ClassVar

import numpy as np
import pytest
from twins import T, cycles, insertion_of

from rcmqp import Insertion, Reference, make_controller
from rcmqp.controllers import Command, Controller, HierarchicalQP
from rcmqp.qp import Bounds, Hierarchy, HierarchySolution, Level
from rcmqp.tasks import RcmTask, Task
from rcmqp.tasks.base import Residual
from rcmqp.world.arm import ArmState


def law_of(insertion: Insertion) -> HierarchicalQP:
    law = make_controller("hierarchical_qp", insertion, T)
    assert isinstance(law, HierarchicalQP)
    return law


def told(command: Command) -> tuple[object, ...]:
    """All that a command says."""
    solution = command.account
    assert isinstance(solution, HierarchySolution)
    levels = [
        (level.name, level.route, level.reached, level.kkt, level.residual.tobytes())
        for level in (solution.limits, *solution.levels, solution.rest)
    ]
    weights = b"".join(level.multipliers.tobytes() for level in solution.levels)
    numbers = command.diagnostics
    assert numbers["safe_stop"] == 0.0
    return command.v.tobytes(), *levels, weights, tuple(numbers.items()), solution.exact


def asked_at_once(law: Controller, insertion: Insertion) -> list[tuple[object, ...]]:
    law.reset()
    return [told(law.step(state, reference)) for state, reference in cycles(insertion)]


@pytest.mark.parametrize("arm", ["lwa3", "meka_a2", "ur5"])
@pytest.mark.parametrize("kept", [1, 2, 3, 1000])
def test_it_is_the_same_however_late_it_is_asked(arm: str, kept: int) -> None:
    insertion = insertion_of(arm)
    law, late = law_of(insertion), law_of(insertion)
    expected = asked_at_once(law, insertion)
    waiting: list[Command] = []
    found: list[tuple[object, ...]] = []
    for state, reference in cycles(insertion):
        waiting.append(late.step(state, reference))
        if len(waiting) >= kept:
            found.append(told(waiting.pop(0)))
    del late, law
    gc.collect()  # an account keeps what it is made of
    found += map(told, waiting)
    assert len({line[1:] for line in found}) > 1
    assert found == expected


def test_a_step_that_nobody_asks_about_changes_nothing_of_the_next() -> None:
    insertion = insertion_of("panda")
    law, other = law_of(insertion), law_of(insertion)
    for k, (state, reference) in enumerate(cycles(insertion)):
        first, second = law.step(state, reference), other.step(state, reference)
        if k % 3 == 0:
            assert told(first) == told(second)
        law.problem(state, reference)  # made where an account may stand
        assert np.array_equal(first.v, second.v)


def test_it_is_there_after_a_reset_and_a_problem() -> None:
    insertion = insertion_of("lwa3")
    law, same = law_of(insertion), law_of(insertion)
    (state, reference), (later, other) = list(cycles(insertion))[:2]
    command = law.step(state, reference)
    law.problem(later, other)
    law.problem(later, other)
    law.reset()
    assert told(command) == told(same.step(state, reference))


@pytest.mark.parametrize("before", [True, False])
def test_a_command_is_copied_with_its_account(before: bool) -> None:
    insertion = insertion_of("lwa3")
    law = law_of(insertion)
    state, reference = next(iter(cycles(insertion)))
    command = law.step(state, reference)
    if before:
        told(command)
    for other in (copy.copy(command), dataclasses.replace(command, stop="")):
        assert told(other) == told(command)
        assert other.diagnostics["safe_stop"] == 0.0


def test_another_thread_may_ask_while_the_law_goes_on() -> None:
    insertion = insertion_of("ur5")
    law, again = law_of(insertion), law_of(insertion)
    expected = asked_at_once(law, insertion)
    commands = [again.step(*both) for both in cycles(insertion)]
    found: list[list[tuple[object, ...]]] = []
    threads = [
        threading.Thread(target=lambda: found.append([told(command) for command in commands]))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for state, reference in cycles(insertion):
        again.step(state, reference)
    for thread in threads:
        thread.join()
    assert found == [expected] * 4


@pytest.mark.parametrize("asks", ["reads", "steps"])
def test_a_finalizer_that_asks_meanwhile_changes_nothing(asks: str) -> None:
    insertion = insertion_of("lwa3")
    states = list(cycles(insertion))
    expected = told(law_of(insertion).step(*states[0]))
    law = law_of(insertion)
    command = law.step(*states[0])
    assert isinstance(command.account, HierarchySolution)
    account = command.account._answer.account
    ran: list[str] = []

    class Asking:
        def __init__(self) -> None:
            self.itself = self

        def __del__(self) -> None:
            ran.append(asks)
            if asks == "reads":
                told(command)
            else:
                for state, reference in states[1:6]:
                    law.step(state, reference)

    gc.collect()
    gc.disable()
    before = gc.get_threshold()
    Asking()
    _kept = [{} for _ in range(200)]  # type: ignore[var-annotated]  # none left of those set aside
    gc.set_threshold(1, 1, 1)
    gc.enable()
    try:
        summary = account.summary
    finally:
        gc.set_threshold(*before)
    assert ran == [asks]
    assert summary is account.summary
    assert told(command) == expected


def test_rows_that_are_given_may_be_another_number_before_it_is_asked() -> None:
    insertion = insertion_of("panda")
    law = make_controller("hierarchical_qp", insertion, T)
    counts = iter([1, 3, 2, 3, 1] * 40)

    class Own(Task):
        name: ClassVar[str] = "own"
        unit: ClassVar[str] = "rad"

        def evaluate(self, state: ArmState, reference: Reference) -> Residual:
            m = next(counts)
            eye = np.eye(state.v.size)[:m]
            return Residual(0.1 * np.arange(1.0, m + 1.0), eye, np.zeros(m))

    assert isinstance(law, HierarchicalQP)
    levels = [RcmTask(period=T), Own()]
    commands = []
    for late in (False, True):
        counts = iter([1, 3, 2, 3, 1] * 40)
        mixed = dataclasses.replace(law, levels=levels)
        answers = []
        for state, reference in cycles(insertion):
            answers.append(mixed.step(state, reference))
            if not late:
                told(answers[-1])
        commands.append([told(answer) for answer in answers])
    assert commands[0] == commands[1]


class Marked(Command):
    """A Command of a user's own."""


class Adding(HierarchicalQP):
    """A law of a user's own, which adds to what it is given, or answers with something else."""

    wrong: ClassVar[str] = ""
    own: ClassVar[type[Command]] = Command

    def _step(self, state: ArmState, reference: Reference) -> Command:
        answer = super()._step(state, reference)
        answer.diagnostics["mine"] = 2.0
        if self.wrong:
            return dataclasses.replace(answer, stop=self.wrong)
        return self.own(answer.v, answer.diagnostics, answer.account)


def test_what_a_law_makes_of_a_command_says_whether_it_stops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    insertion = insertion_of("lwa3")
    law = Adding(insertion, T)
    state, reference = next(iter(cycles(insertion)))
    for own in (Command, Marked):
        monkeypatch.setattr(Adding, "own", own)
        answer = law.step(state, reference)
        assert type(answer) is own
        assert (answer.diagnostics["mine"], answer.diagnostics["safe_stop"]) == (2.0, 0.0)
    monkeypatch.setattr(Adding, "wrong", "mine")
    assert law.step(state, reference).diagnostics["safe_stop"] == 1.0


def test_a_command_that_is_replaced_leaves_the_first_as_it_was() -> None:
    law = law_of(insertion_of("lwa3"))
    command = law.step(*next(iter(cycles(law.insertion))))
    other = dataclasses.replace(command, stop="mine")
    assert (type(other), other.stop) == (Command, "mine")
    assert (command.stop, command.diagnostics["safe_stop"]) == ("", 0.0)
    given = {"a": 1.0}
    Command(command.v, given)
    assert given == {"a": 1.0}


def test_what_hierarchy_solves_has_no_names_to_record() -> None:
    level = Level(np.eye(2), np.ones(2), "both")
    solution = Hierarchy().solve([level], Bounds(-np.ones(2), np.ones(2)))
    assert solution.recorded == {}
    assert solution.exact


def test_a_command_has_no_other_attributes() -> None:
    law = law_of(insertion_of("lwa3"))
    command = law.step(*next(iter(cycles(law.insertion))))
    with pytest.raises(AttributeError, match="no attribute 'velocity'"):
        _ = command.velocity  # type: ignore[attr-defined]
