"""Where the chunks of a job run: this process, child processes, or a Dask cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
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


def _run(
    executor: Executor, ahead: int, lost: tuple[type[Exception], str], function: Callable[..., Any], tasks: Tasks
) -> Iterator[tuple[int, Any]]:
    """`ahead` tasks at a time. lost: the error that a lost worker raises, and what it means."""
    waiting, keys = iter(tasks), dict[Future[Any], int]()
    try:
        for key, task in islice(waiting, ahead):
            with _undisturbed():
                keys[executor.submit(function, *task)] = key
        while keys:
            for future in wait(keys, return_when=FIRST_COMPLETED).done:
                yield keys.pop(future), future.result()
                for key, task in islice(waiting, 1):
                    keys[executor.submit(function, *task)] = key
    except (CancelledError, lost[0]) as error:
        raise NoSolutionError(f"{lost[1]}; {_ADVICE}") from error


def _in_processes(count: int, function: Callable[..., Any], tasks: Tasks) -> Iterator[tuple[int, Any]]:
    """No process outlives the iteration."""
    from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
    from multiprocessing import get_context

    # Not fork: CasADi and NumPy hold threads, which a forked child would inherit broken.
    pool = ProcessPoolExecutor(count, get_context("spawn"), _end_with_the_parent)
    try:
        yield from _run(pool, count, (BrokenProcessPool, "a worker died"), function, tasks)
    finally:
        for process in list((pool._processes or {}).values()):
            process.kill()
        pool.shutdown()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Signals wait until a process has started, which inherits that: it never sees Ctrl-C, which a terminal gives to
    every process of a run."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start, which comes with that of the first process, unblocks signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_the_parent() -> None:
    """What each process runs first: it ends when the process that started it is gone, however that ended."""
    import multiprocessing

    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _cluster(scheduler: str) -> Iterator[Run]:
    try:
        from dask.distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise BadInputError("a scheduler needs Dask; install it with `pip install .[distributed]`") from error
    logging.disable()  # what Dask logs of a lost connection, in tracebacks, is one line of ours
    try:
        try:
            client = Client(scheduler, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError) as error:
            advice = "start one, or use --workers"
            raise BadInputError(f"no Dask scheduler answers at {scheduler} ({error}); {advice}") from None
        with client:
            threads = sum(client.nthreads().values())
            if not threads:
                raise BadInputError(f"the Dask scheduler at {scheduler} has no workers; start some")
            executor = client.get_executor(pure=False, retries=_RETRIES)
            yield partial(_run, executor, _AHEAD * threads, (KilledWorker, "the cluster gave a chunk up"))
    finally:
        logging.disable(logging.NOTSET)
