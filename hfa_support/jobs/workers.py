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

#: Chunks in flight for each thread of a cluster: enough to keep it busy, few enough to keep memory
#: flat.
_AHEAD = 2
#: How often Dask runs a task again whose worker was lost.
_RETRIES = 3
#: Within which a scheduler must answer.
_ANSWER = "10s"
_ADVICE = "see the log of the workers, and continue with --resume what was written to a store"

Tasks = Iterable[tuple[int, tuple[Any, ...]]]
#: (function, tasks) -> (key, function(*task)) of each, in the order in which they finish.
Run = Callable[[Callable[..., Any], Tasks], Iterator[tuple[int, Any]]]


@contextmanager
def workers(count: int = 1, scheduler: str | None = None) -> Iterator[Run]:
    """What runs tasks: this process (count 1), `count` processes, or the Dask cluster at
    `scheduler` (tcp://host:port).

    BadInputError when the count is not positive, Dask is not installed or the scheduler does not
    answer. Running raises NoSolutionError when a worker dies, or the cluster gives a task up."""
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


def _in_processes(
    count: int, function: Callable[..., Any], tasks: Tasks
) -> Iterator[tuple[int, Any]]:
    """Each process receives tasks and answers through its pipe. No process outlives the
    iteration."""
    import multiprocessing
    from multiprocessing.connection import wait

    # Not fork: CasADi and NumPy hold threads, which a forked child would inherit broken.
    context, waiting = multiprocessing.get_context("spawn"), iter(tasks)
    started: list[Any] = []
    busy: dict[Any, int] = {}
    try:
        for key, task in islice(waiting, count):
            connection, end = context.Pipe()
            started.append(context.Process(target=_serve, args=(end,), daemon=True))
            with _undisturbed():
                started[-1].start()
            end.close()
            connection.send((function, task))
            busy[connection] = key
        while busy:
            ready: Any
            for ready in wait(list(busy)):
                result, error = ready.recv()
                if error is not None:
                    raise error
                yield busy.pop(ready), result
                for key, task in islice(waiting, 1):
                    ready.send((function, task))
                    busy[ready] = key
    except (EOFError, ConnectionError) as error:
        raise NoSolutionError(f"a worker died; {_ADVICE}") from error
    finally:
        for process in started:
            process.kill()


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Signals wait until a process has started, which inherits that: it never sees Ctrl-C, which a
    terminal gives to every process of a run."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start, which comes with that of the first process, unblocks signals
    before = signal.pthread_sigmask(
        signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    )
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Any) -> None:
    """Answer each (function, task) with (result, None) or (None, error); end when the process that
    started this one is gone, however that ended."""
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
                answer: tuple[Any, Exception | None] = function(*task), None
            except Exception as error:
                error.add_note(traceback.format_exc())  # a traceback does not go through a pipe
                answer = None, error
            connection.send(answer)


@contextmanager
def _cluster(scheduler: str) -> Iterator[Run]:
    try:
        from concurrent.futures import CancelledError

        from dask.distributed import Client, as_completed
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise BadInputError(
            "a scheduler needs Dask; install it with `pip install .[distributed]`"
        ) from error

    def run(function: Callable[..., Any], tasks: Tasks) -> Iterator[tuple[int, Any]]:
        waiting, keys = iter(tasks), dict[Any, int]()

        def submitted(count: int) -> list[Any]:
            found = {
                client.submit(function, *t, pure=False, retries=_RETRIES): key
                for key, t in islice(waiting, count)
            }
            keys.update(found)
            return [*found]

        finished = as_completed(submitted(_AHEAD * threads), loop=client.loop)
        try:
            for future in finished:
                yield keys.pop(future), future.result()
                finished.update(submitted(1))
        except (KilledWorker, CancelledError, CommClosedError) as error:
            raise NoSolutionError(
                f"the cluster gave a chunk up ({type(error).__name__}); {_ADVICE}"
            ) from error

    logging.disable()  # what Dask logs of a lost connection, in tracebacks, is one line of ours
    try:
        try:
            client = Client(scheduler, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError) as error:
            advice = "start one, or use --workers"
            raise BadInputError(
                f"no Dask scheduler answers at {scheduler} ({error}); {advice}"
            ) from None
        with client:
            threads = sum(client.nthreads().values())
            if not threads:
                raise BadInputError(f"the Dask scheduler at {scheduler} has no workers; start some")
            yield run
    finally:
        logging.disable(logging.NOTSET)
