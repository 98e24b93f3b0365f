"""Where the chunks of a job run: this process, child processes, or a Dask cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from typing import Any

from hfa_support.errors import BadInputError, NoSolutionError

#: Chunks in flight for each thread of a cluster: enough to keep it busy, few enough to keep memory flat.
_AHEAD = 2
#: How often Dask runs a task again whose worker was lost.
_RETRIES = 3
#: Within which a scheduler must answer.
_ANSWER = "10s"
_ADVICE = "see the log of the workers, and continue with --resume what was written to a store"

Task = tuple[Any, ...]
Tasks = Iterable[tuple[int, Task]]
#: (function, tasks) -> (key, function(*task)) of each, in the order in which they finish.
Run = Callable[[Callable[..., Any], Tasks], Iterator[tuple[int, Any]]]


@contextmanager
def workers(count: int = 1, scheduler: str | None = None) -> Iterator[Run]:
    """What runs tasks: this process (count 1), `count` processes, or the Dask cluster at `scheduler` (tcp://host:port).

    BadInputError when the count is not positive, Dask is not installed or the scheduler does not answer. Running
    raises NoSolutionError when a worker dies, or the cluster gives a task up.
    """
    if count < 1:
        raise BadInputError(f"the number of workers is {count}; it must be at least 1")
    if scheduler is not None:
        with _cluster(scheduler) as run:
            yield run
    else:
        yield _here if count == 1 else partial(_in_processes, count)


def _here(function: Callable[..., Any], tasks: Tasks) -> Iterator[tuple[int, Any]]:
    for key, task in tasks:
        yield key, function(*task)


def _in_processes(count: int, function: Callable[..., Any], tasks: Tasks) -> Iterator[tuple[int, Any]]:
    """Each process receives tasks and answers through its pipe. No process outlives the iteration."""
    import multiprocessing
    from multiprocessing.connection import wait

    # Not fork: CasADi and NumPy hold threads, which a forked child would inherit broken.
    context, waiting = multiprocessing.get_context("spawn"), iter(tasks)
    started: list[Any] = []
    connection: Any
    busy: dict[Any, int] = {}
    try:
        for key, task in islice(waiting, count):
            connection, end = context.Pipe()
            started.append(context.Process(target=_serve, args=(end,), daemon=True))
            _start(started[-1])
            end.close()
            connection.send((function, task))
            busy[connection] = key
        while busy:
            for ready in wait(list(busy)):
                connection = ready
                result, error = connection.recv()
                if error is not None:
                    raise error
                yield busy.pop(connection), result
                for key, task in islice(waiting, 1):
                    connection.send((function, task))
                    busy[connection] = key
    except (EOFError, ConnectionError) as error:
        raise NoSolutionError(f"a worker died; {_ADVICE}") from error
    finally:
        for process in started:
            process.kill()


def _start(process: Any) -> None:
    """Start a process that never sees Ctrl-C, which a terminal gives to every process of a run.

    A signal that would end this process meanwhile waits for the start: half a start makes the child complain.
    """
    if not hasattr(signal, "pthread_sigmask"):
        process.start()
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start, which comes with that of the first process, unblocks the signal
    arrived: list[int] = []
    handlers = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    own = {each: handler for each, handler in handlers.items() if callable(handler)}
    if threading.current_thread() is not threading.main_thread():
        own = {}  # Python runs handlers, and sets them, in the main thread alone
    for each in own:
        signal.signal(each, lambda number, _: arrived.append(number))
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for each, handler in own.items():
            signal.signal(each, handler)
        for number in arrived:
            signal.raise_signal(number)


def _serve(connection: Any) -> None:
    """Answer each (function, task) with (result, None) or (None, error); end when the process that started this one
    is gone, however that ended."""
    import multiprocessing

    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    with suppress(EOFError, OSError):  # of a pipe whose other end is gone
        while True:
            function, task = connection.recv()
            try:
                result, failure = function(*task), None
            except Exception as error:
                error.add_note(traceback.format_exc())  # a traceback does not go through a pipe
                result, failure = None, error
            connection.send((result, failure))


@contextmanager
def _cluster(scheduler: str) -> Iterator[Run]:
    try:
        from concurrent.futures import CancelledError

        from dask.distributed import Client, as_completed
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise BadInputError("a scheduler needs Dask; install it with `pip install .[distributed]`") from error
    try:
        client = Client(scheduler, timeout=_ANSWER, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one, or use --workers"
        ) from None

    def run(function: Callable[..., Any], tasks: Tasks) -> Iterator[tuple[int, Any]]:
        waiting = iter(tasks)
        keys: dict[Any, int] = {}

        def submitted(count: int) -> list[Any]:
            found = []
            for key, task in islice(waiting, count):
                found.append(client.submit(function, *task, pure=False, retries=_RETRIES))
                keys[found[-1]] = key
            return found

        finished = as_completed(submitted(_AHEAD * threads), loop=client.loop)
        try:
            for future in finished:
                yield keys.pop(future), future.result()
                finished.update(submitted(1))
        except (KilledWorker, CancelledError, CommClosedError) as error:
            raise NoSolutionError(f"the cluster gave a chunk up ({type(error).__name__}); {_ADVICE}") from error

    with _quiet("distributed"), client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise BadInputError(f"the Dask scheduler at {scheduler} has no workers; start some")
        yield run


@contextmanager
def _quiet(package: str) -> Iterator[None]:
    """A package logs nothing while the block runs: what Dask logs of a lost connection, in tracebacks, is one line of
    ours."""
    loggers = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.startswith(package)]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
