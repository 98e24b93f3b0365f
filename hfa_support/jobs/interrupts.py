"""Ctrl-C and SIGTERM: what ends a run, whatever it does then, and what holds them back for a moment."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_ENDING = (signal.SIGINT, signal.SIGTERM)
#: Seconds after which a signal whose exception was dropped is given again.
_MOMENT = 0.05


@contextmanager
def held_back() -> Iterator[None]:
    """Signals that come while the block runs are given after it; also a decorator.

    For calls of libraries with threads of their own, which go on, and complain at length, when their caller is gone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came, holding = list[signal.Signals](), True
    before = {number: signal.getsignal(number) for number in _ENDING}

    def hold(number: int, _: object) -> None:
        if holding:
            came.append(signal.Signals(number))
        else:  # after the block, and before this was taken back
            signal.signal(number, before[signal.Signals(number)])
            signal.raise_signal(number)

    try:
        for number in _ENDING:
            signal.signal(number, hold)
        yield
    finally:
        holding = False
        for number, handler in before.items():
            if signal.getsignal(number) == hold:  # else a signal came meanwhile, and its handler set another
                signal.signal(number, handler)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


@contextmanager
def blocked_in_children() -> Iterator[None]:
    """Processes that the block starts never see Ctrl-C, which a terminal gives to every process of a run.

    One that saw it would print where it was; who starts them ends them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Terminated(KeyboardInterrupt):
    """SIGTERM: what Ctrl-C ends, this ends too."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """In the block SIGTERM raises `Terminated`, once, so that temporary files and workers go.

    An exception that ends the run may be raised where it is dropped: in a callback of the garbage collector or of an
    import, which Python only prints, or in a question of CasADi's about an array, to which it is a no. The signal is
    then given again, or the run would go on as if nobody had asked. Compiled code makes another exception of it, which
    is taken for what it was.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    defaults = {signal.SIGTERM: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    ours = {number: handler for number, handler in defaults.items() if signal.getsignal(number) == handler}
    print_it, outside = sys.unraisablehook, _handled()
    came: list[type[KeyboardInterrupt]] = []
    on_its_way, over = set[int](), False

    def end(number: int, _: object) -> None:
        if number == signal.SIGTERM and number in on_its_way:
            return
        on_its_way.add(number)
        came.append(Terminated if number == signal.SIGTERM else KeyboardInterrupt)
        _thread.start_new_thread(watch, (number,))  # not of `threading`: its locks may be held where the signal comes
        raise came[-1]

    def watch(number: int) -> None:
        time.sleep(_MOMENT)
        while not over and _handled() not in (None, outside):
            time.sleep(_MOMENT)
        if not over:
            on_its_way.discard(number)
            _give(signal.Signals(number))

    def only_others(ignored: sys.UnraisableHookArgs) -> None:
        if not (came and isinstance(ignored.exc_value, KeyboardInterrupt)):
            print_it(ignored)

    for number in ours:
        signal.signal(number, end)
    sys.unraisablehook = only_others
    try:
        yield
    except Exception:
        if came:
            raise came[-1] from None
        raise
    finally:
        over = True
        sys.unraisablehook = print_it
        for number, handler in ours.items():
            signal.signal(number, handler)


def _handled() -> object:
    """The exception in whose `except` or `finally` the main thread is, or None."""
    found = sys._current_exceptions().get(threading.main_thread().ident or 0)
    return found[1] if isinstance(found, tuple) else found  # Python 3.11 has its type and traceback beside it


def _give(number: signal.Signals) -> None:
    """A signal to the main thread; by the system where that can be had, because only that wakes it from a wait."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        _thread.interrupt_main(number)
