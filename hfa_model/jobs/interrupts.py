"""Ctrl-C and SIGTERM: what ends a run, whatever it does then, and what holds them back for a moment."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_ENDING = (signal.SIGINT, signal.SIGTERM)
#: Seconds after which a signal that Python swallowed is given again.
_MOMENT = 0.05


@contextmanager
def held_back() -> Iterator[None]:
    """Signals that come while the block runs are given after it; also a decorator.

    For calls of libraries with threads of their own, which go on, and complain at length, when their caller is gone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.signal(number, lambda which, _: came.append(which)) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for which in dict.fromkeys(came):
            signal.raise_signal(which)


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

    An exception that ends the run may be raised where Python only prints it (in a callback of the garbage collector or
    of an import); the signal is then given again, or the run would go on as if nobody had asked. Compiled code makes
    another exception of it, which is taken for what it was.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    defaults = {signal.SIGTERM: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    ours = {number: handler for number, handler in defaults.items() if signal.getsignal(number) == handler}
    print_it = sys.unraisablehook
    came: list[type[KeyboardInterrupt]] = []

    def end(number: int, _: object) -> None:
        if number == signal.SIGTERM:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        came.append(Terminated if number == signal.SIGTERM else KeyboardInterrupt)
        raise came[-1]

    def again(ignored: sys.UnraisableHookArgs) -> None:
        if not isinstance(ignored.exc_value, KeyboardInterrupt):
            print_it(ignored)
            return
        number = signal.SIGTERM if isinstance(ignored.exc_value, Terminated) else signal.SIGINT
        if number == signal.SIGTERM:
            signal.signal(signal.SIGTERM, end)
        timer = threading.Timer(_MOMENT, _give, [number])
        timer.daemon = True
        timer.start()

    for number in ours:
        signal.signal(number, end)
    sys.unraisablehook = again
    try:
        yield
    except Exception:
        if came:
            raise came[-1] from None
        raise
    finally:
        sys.unraisablehook = print_it
        for number, handler in ours.items():
            signal.signal(number, handler)


def _give(number: signal.Signals) -> None:
    """A signal to the main thread; by the system where that can be had, because only that wakes it from a wait."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        _thread.interrupt_main(number)
