"""Executors of independent tasks: this process, child processes, or a Dask cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from typing import Any

from hfa_support.errors import BadInputError, NoSolutionError, missing_package

#: Submitted tasks per worker: enough to keep the worker busy without using more memory.
_AHEAD = 2
#: Number of times Dask repeats a task whose worker was lost.
_RETRIES = 3
#: Time within which a scheduler must respond.
_ANSWER = "10s"
_ADVICE = "if the results are in a store, continue with --resume"

#: (key, arguments of the function) of each task.
Tasks = Iterable[tuple[int, tuple[Any, ...]]]
#: (function, tasks) -> (key, function(*arguments)) of each task, in the order in which they finish.
Run = Callable[[Callable[..., Any], Tasks], Iterator[tuple[int, Any]]]


@contextmanager
def open_workers(workers: int | str) -> Iterator[Run]:
    """Context manager that provides an executor of tasks.

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
    for key, arguments in tasks:
        yield key, function(*arguments)


def _run_in(
    pool: Executor, in_flight: int, function: Callable[..., Any], tasks: Tasks
) -> Iterator[tuple[int, Any]]:
    """Run tasks in a pool, and yield (key, result) as each task finishes."""
    waiting = iter(tasks)
    keys: dict[Future[Any], int] = {}

    def submit(count: int) -> None:
        for key, arguments in islice(waiting, count):
            keys[pool.submit(function, *arguments)] = key

    submit(in_flight)
    while keys:
        finished, _ = wait(keys, return_when=FIRST_COMPLETED)
        for future in finished:
            yield keys.pop(future), future.result()
            submit(1)


@contextmanager
def _processes(count: int) -> Iterator[Run]:
    """Context manager that provides an executor with `count` child processes."""
    # `ProcessPoolExecutor` is not suitable. This class cannot kill its workers, and its semaphores
    # are reported as leaked if a signal ends this process.
    import multiprocessing

    # CasADi and NumPy have threads, which would not work in a forked process.
    context = multiprocessing.get_context("spawn")
    children: list[Any] = []
    this_thread = threading.local()  # each thread of the pool has a child process of its own

    def start_child() -> None:
        """Start the child process of this thread, and connect it."""
        try:
            this_thread.connection, child_end = context.Pipe()
            child = context.Process(target=_serve, args=(child_end,), daemon=True)
            with _signals_blocked():  # only the parent process responds to Ctrl-C
                child.start()
        except OSError as error:  # too many files are open, or too many processes run
            raise BadInputError(
                f"no worker can be started ({error.strerror}); use fewer workers"
            ) from error
        children.append(child)
        child_end.close()

    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        """Return function(*arguments) from the child process of this thread."""
        if not hasattr(this_thread, "connection"):
            start_child()
        try:
            this_thread.connection.send((function, arguments))
            result, error = this_thread.connection.recv()
        except (EOFError, ConnectionError) as lost:
            raise NoSolutionError(f"a worker process ended unexpectedly; {_ADVICE}") from lost
        if error is not None:
            raise error
        return result

    pool = ThreadPoolExecutor(count)
    try:
        yield lambda function, tasks: _run_in(pool, count, partial(call, function), tasks)
    finally:
        for child in children:
            child.kill()
        pool.shutdown(cancel_futures=True)


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Block SIGINT, SIGTERM and SIGHUP in this thread while the context is open."""
    # A process that is started in this context inherits the blocked signals permanently. Ctrl-C in
    # a terminal reaches every process, and only the parent process must respond.
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


def _serve(connection: Any) -> None:
    """Evaluate the calls received from the parent process, and send the results."""
    # A call is (function, arguments). The answer is (result, None) or (None, error). The process
    # ends when its parent process ends for any reason.
    import multiprocessing

    parent = multiprocessing.parent_process()
    assert parent is not None  # this is a child process

    def end_with_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the other end of the pipe is closed
        while True:
            function, arguments = connection.recv()
            try:
                answer: tuple[Any, Exception | None] = (function(*arguments), None)
            except Exception as error:
                error.add_note(traceback.format_exc())  # a traceback cannot be sent through a pipe
                answer = (None, error)
            connection.send(answer)


@contextmanager
def _cluster(address: str) -> Iterator[Run]:
    """Context manager that provides an executor of a Dask cluster."""
    # `address` is the address of the scheduler. Raises BadInputError if Dask is missing, the
    # scheduler does not respond or it has no workers.
    try:
        from dask.distributed import Client
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise missing_package("a Dask scheduler requires", "distributed") from error

    logging.disable()  # Dask logs tracebacks of a lost connection; we report one line
    try:
        try:
            client = Client(address, timeout=_ANSWER, set_as_default=False)
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
                pool = client.get_executor(pure=False, retries=_RETRIES)
                yield partial(_run_in, pool, _AHEAD * threads)
            except (KilledWorker, CancelledError, CommClosedError) as error:
                raise NoSolutionError(
                    f"the Dask cluster abandoned a chunk of rows ({type(error).__name__}); "
                    f"{_ADVICE}"
                ) from error
    finally:
        logging.disable(logging.NOTSET)
