"""Signals that are held back: given after the block, once, and not lost."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from types import FrameType
from typing import Any

import pytest

from hfa_support.jobs import interrupts
from hfa_support.jobs.interrupts import Terminated, ended_by_signals, held_back


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
    try:
        raise ValueError
    except ValueError:  # what is handled outside has nothing to do with it
        with pytest.raises(ending), ended_by_signals():
            work()


def test_what_python_only_prints_is_printed_still() -> None:
    said: list[Any] = []
    before, sys.unraisablehook = sys.unraisablehook, said.append

    class Broken:
        def __del__(self) -> None:
            raise ValueError

    try:
        with ended_by_signals():
            Broken()
    finally:
        sys.unraisablehook = before
    assert [each.exc_type for each in said] == [ValueError]


@ended_by_signals()
def cleared_up(number: signal.Signals, other: signal.Signals) -> None:
    try:
        signal.raise_signal(number)
    finally:
        if number == signal.SIGTERM:
            signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(other)
        time.sleep(0.2)  # what ends it is being handled: not given again


def test_after_sigterm_another_is_not_heard_and_after_ctrl_c_it_is() -> None:
    for number, other in ((signal.SIGTERM, signal.SIGINT), (signal.SIGINT, signal.SIGTERM)):
        with pytest.raises(KeyboardInterrupt):
            cleared_up(number, other)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_wherever_a_signal_comes_it_ends_the_run_and_the_next_is_heard(number: signal.Signals) -> None:
    step, said = 0, list[str]()
    while said != ["begun", "finished", "after"]:
        step, steps, said = step + 1, 0, []

        def trace(frame: FrameType, event: str, _: object, last: int = step) -> Any:
            nonlocal steps
            if frame.f_code.co_filename not in (interrupts.__file__, contextlib.__file__, signal.__file__):
                return None
            steps += event in ("call", "line")
            if steps == last:
                signal.raise_signal(number)
            # Lines of others: a tracer that raises within an `except` leaves Python in it.
            return trace if frame.f_code.co_filename == interrupts.__file__ else None

        with ended_by_signals():
            sys.settrace(trace)
            try:
                with held_back():
                    said.append("begun")
                    said.append("finished")
                said.append("after")
            except KeyboardInterrupt:
                said.append("ended")
                for each in (signal.SIGINT, signal.SIGTERM):
                    if (number, each) != (signal.SIGTERM, signal.SIGTERM):
                        with pytest.raises(KeyboardInterrupt):
                            signal.raise_signal(each)
            finally:
                sys.settrace(None)
        assert said[-1:] in (["ended"], ["after"]), step
        assert "begun" not in said or "finished" in said, step
    assert step > 30
