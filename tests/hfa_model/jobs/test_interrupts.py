"""Signals that are held back: given after the block, once, and not lost."""

from __future__ import annotations

import signal
import threading
import time

import pytest

from hfa_model.jobs.interrupts import Terminated, ended_by_signals, held_back


def test_a_signal_is_given_after_the_block() -> None:
    steps: list[str] = []

    @held_back()
    def work() -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        steps.append("finished")

    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        work()
    assert steps == ["finished"]
    assert signal.getsignal(signal.SIGINT) == handler
    with held_back():
        steps.append("again")
    assert steps == ["finished", "again"]


def test_an_error_of_the_block_stays_one() -> None:
    with pytest.raises(ValueError, match="wrong"), held_back():
        raise ValueError("wrong")


def test_another_thread_holds_nothing_back() -> None:
    seen: list[object] = []

    def work() -> None:
        with held_back():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT)]


@pytest.mark.parametrize(("number", "ending"), [(signal.SIGTERM, Terminated), (signal.SIGINT, KeyboardInterrupt)])
def test_a_signal_that_comes_where_python_only_prints_it_is_given_again(
    number: signal.Signals, ending: type[KeyboardInterrupt]
) -> None:
    class Gone:
        def __del__(self) -> None:
            signal.raise_signal(number)

    def work() -> None:
        Gone()
        time.sleep(5.0)

    with pytest.raises(KeyboardInterrupt) as raised, ended_by_signals():
        work()
    assert raised.type is ending


def test_after_sigterm_another_is_not_heard_and_after_ctrl_c_it_is() -> None:
    deaf = []
    for number in (signal.SIGTERM, signal.SIGINT):
        with ended_by_signals():
            try:
                signal.raise_signal(number)
            except KeyboardInterrupt:
                deaf.append(signal.getsignal(signal.SIGTERM) == signal.SIG_IGN)
    assert deaf == [True, False]
