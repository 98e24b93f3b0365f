"""Executors of independent tasks: this process, child processes, or a Dask cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any

from hfa_support.errors import BadInputError, NoSolutionError, missing_package
from hfa_support.origin import toolchain

#: Submitted tasks per worker of a cluster: one is computed while the next is sent.
_TASKS_PER_THREAD = 2
#: Number of times Dask repeats a task whose worker was lost.
_RETRIES = 3
#: Time within which a scheduler must respond.
_ANSWER_TIME = "10s"
_RESUME_ADVICE = "if the results are in a store, continue with --resume"

#: (key, arguments of the function) of each task.
Tasks = Iterable[tuple[int, tuple[Any, ...]]]
#: (function, tasks) -> (key, function(*arguments)) of each task, in the order in which they finish.
Run = Callable[[Callable[..., Any], Tasks], Iterator[tuple[int, Any]]]


@contextmanager
def open_workers(workers: int | str) -> Iterator[Run]:
    """Yield an executor of tasks, which runs a function for the arguments of each task.

    workers: 1 for this process, a number of child processes, or the address of a Dask scheduler,
        tcp://host:port

    Raises BadInputError if the number is not positive, no child process can be started, Dask is not
    installed, or the scheduler does not respond or has no workers. A task raises NoSolutionError if
    a worker dies or the cluster abandons the task.
    """
    if isinstance(workers, str):
        with _cluster(workers) as run:
            yield run
    elif workers < 1:
        raise BadInputError(f"the number of workers is {workers}; give at least 1")
    elif workers == 1:
        yield _run_in_process
    else:
        with _processes(workers) as run:
            yield run


def _run_in_process(function: Callable[..., Any], tasks: Tasks) -> Iterator[tuple[int, Any]]:
    """Run tasks one after the other in this process, and yield (key, result) of each."""
    for key, arguments in tasks:
        yield key, function(*arguments)


def _run_in(
    pool: Executor, in_flight: int, function: Callable[..., Any], tasks: Tasks
) -> Iterator[tuple[int, Any]]:
    """Run tasks in a pool, and yield (key, result) as each task finishes.

    in_flight: number of tasks that are submitted and not finished
    """
    ours = toolchain()
    waiting = iter(tasks)
    keys: dict[Future[Any], int] = {}

    def submit(count: int) -> None:
        for key, arguments in islice(waiting, count):
            keys[pool.submit(_call_same_code, ours, function, *arguments)] = key

    submit(in_flight)
    while keys:
        finished, _ = wait(keys, return_when=FIRST_COMPLETED)
        for future in finished:
            yield keys.pop(future), future.result()
            submit(1)


def _call_same_code(theirs: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a function returns in this worker. Raises BadInputError if the worker has another
    version of the project than the process that submits tasks, `theirs`.
    """
    if (ours := toolchain()) != theirs:
        raise BadInputError(
            f"a worker has hfa {ours}, but this process has {theirs}; install one of them on both, "
            "and start the workers again"
        )
    return function(*arguments)


@contextmanager
def _processes(count: int) -> Iterator[Run]:
    """Yield an executor with `count` child processes."""
    import multiprocessing

    context = multiprocessing.get_context("spawn")  # a fork of a process with threads may deadlock
    pool = _Processes(count, context, initializer=_end_with_parent)
    try:
        yield partial(_run_in, pool, count)
    except BrokenProcessPool as lost:
        raise NoSolutionError(f"a worker process ended unexpectedly; {_RESUME_ADVICE}") from lost
    finally:
        for child in multiprocessing.active_children():  # a task may take minutes
            child.kill()
        pool.shutdown(cancel_futures=True)


class _Processes(ProcessPoolExecutor):
    """Pool of child processes that do not respond to Ctrl-C: the parent does, and ends them."""

    def submit(self, *call: Any, **named: Any) -> Future[Any]:
        """Submit a call, which may start a child process."""
        with _signals_blocked():  # a child that is started here inherits the blocked signals
            try:
                return super().submit(*call, **named)
            except OSError as error:  # too many files are open, or too many processes run
                raise BadInputError(
                    f"no worker can be started ({error.strerror}); use fewer workers"
                ) from error


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Block SIGINT, SIGTERM and SIGHUP in this thread while the context is open. A process that is
    started meanwhile inherits the blocked signals permanently.
    """
    # Ctrl-C in a terminal reaches every process, and only the parent process must respond.
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # The resource tracker starts with the first process and would unblock the signals.
    resource_tracker.ensure_running()
    ending = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ending)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent() -> None:
    """Start a thread that ends this child process when its parent ends."""
    import multiprocessing

    parent = multiprocessing.parent_process()
    assert parent is not None  # this is a child process

    def wait_and_end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=wait_and_end, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[Run]:
    """Yield an executor of the Dask cluster whose scheduler has this address."""
    try:
        from dask.distributed import Client
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise missing_package("a Dask scheduler requires", "distributed") from error

    logging.disable()  # Dask logs tracebacks of a lost connection; we report one line
    try:
        try:
            client = Client(address, timeout=_ANSWER_TIME, set_as_default=False)
        except (OSError, ValueError) as error:
            raise BadInputError(
                f"no Dask scheduler responds at {address} ({error}); start a scheduler, or give a "
                "number of processes"
            ) from None
        with client:
            threads = sum(client.nthreads().values())
            if not threads:
                raise BadInputError(
                    f"the Dask scheduler at {address} has no workers; start at least one worker"
                )
            try:
                # Unless they are impure, Dask would run two equal tasks once.
                pool = client.get_executor(pure=False, retries=_RETRIES)
                yield partial(_run_in, pool, _TASKS_PER_THREAD * threads)
            except (AttributeError, ImportError) as error:  # our function is unknown there
                raise BadInputError(
                    f"a worker of the Dask scheduler at {address} has another version of hfa "
                    f"({error}); install {toolchain()} there, and start the workers again"
                ) from error
            except (KilledWorker, CancelledError, CommClosedError) as error:
                raise NoSolutionError(
                    f"the Dask cluster abandoned a chunk of rows ({type(error).__name__}); "
                    f"{_RESUME_ADVICE}"
                ) from error
    finally:
        logging.disable(logging.NOTSET)
