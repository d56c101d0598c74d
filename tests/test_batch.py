"""Work in several processes."""

from __future__ import annotations

import signal

from rcmqp.experiments.batch import batch


def ignores_interrupts(number: int) -> bool:
    return signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_ctrl_c_reaches_this_process_and_not_its_workers() -> None:
    before = signal.getsignal(signal.SIGINT)
    results = batch(ignores_interrupts, [(0,), (1,)], jobs=2)
    assert signal.getsignal(signal.SIGINT) is before
    assert sorted(results) == [(0, True), (1, True)]
