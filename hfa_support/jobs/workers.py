"""Where the chunks of a sweep run: this process, a pool of processes, or a Dask cluster."""

from __future__ import annotations

import logging
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Any

from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jobs.interrupts import blocked_in_children, held_back

#: Chunks in flight for each worker: enough to keep it busy, few enough to keep memory flat.
_AHEAD = 2
#: A chunk that takes its worker down this often is not run again.
_MOST_DEATHS = 3
#: Seconds without a result after which it is asked whether any worker is left.
_PATIENCE = 30.0
#: Seconds that workers have to end by themselves, and within which it is seen that they have.
_GONE, _ENDED = 0.5, 10.0
#: Within which a scheduler must answer.
_ANSWER = "10s"
_ADVICE = "see the log of the workers, and continue with --resume what was written to a store"

Task = tuple[Any, ...]
#: In a worker: it is to end.
_leaving = threading.Event()


class Workers:
    """Runs `function(*task)` for many tasks and yields (key, result) as they finish.

    make: new executor. count: tasks that it runs at once. alive: whether any worker is there; asked when nothing has
    finished for `_PATIENCE` seconds. lost: what a future raises when the executor has given its task up for good.
    """

    def __init__(
        self,
        make: Callable[[], Executor],
        count: int,
        alive: Callable[[], bool] = lambda: True,
        lost: tuple[type[BaseException], ...] = (),
    ) -> None:
        self._make, self._count, self._alive, self._lost = make, count, alive, lost

    def run(self, function: Callable[..., Any], tasks: Iterable[tuple[int, Task]]) -> Iterator[tuple[int, Any]]:
        """Results in the order in which they finish. Tasks of a worker that died are run again on new workers.

        NoSolutionError when workers die `_MOST_DEATHS` times with nothing finished between, or none is left.
        """
        waiting = iter(tasks)
        left: dict[int, Task] = {}
        deaths = 0
        while True:
            executor = self._make()
            try:
                for key, result in self._run(executor, function, waiting, left):
                    deaths = 0
                    yield key, result
                return
            except BrokenProcessPool as error:
                deaths += 1
                if deaths >= _MOST_DEATHS:
                    raise NoSolutionError(f"workers died {deaths} times in a row; {_ADVICE}") from error
            except self._lost as error:
                raise NoSolutionError(f"the cluster gave a chunk up ({type(error).__name__}); {_ADVICE}") from error
            finally:
                executor.shutdown(wait=False)

    def _run(
        self,
        executor: Executor,
        function: Callable[..., Any],
        waiting: Iterator[tuple[int, Task]],
        left: dict[int, Task],
    ) -> Iterator[tuple[int, Any]]:
        futures: dict[Future[Any], int] = {}
        # A queue, not `wait`, which looks at every future each time: thousands, with a thousand workers.
        finished: SimpleQueue[Future[Any]] = SimpleQueue()

        def submit(key: int, task: Task) -> None:
            with held_back(), blocked_in_children():  # it may start a process
                future = executor.submit(_worked, function, *task)
            futures[future] = key
            future.add_done_callback(finished.put)

        for key, task in left.items():
            submit(key, task)
        while True:
            while len(futures) < _AHEAD * self._count and (item := next(waiting, None)) is not None:
                left[item[0]] = item[1]
                submit(*item)
            if not futures:
                return
            future = self._next(finished)
            result = future.result()
            key = futures.pop(future)
            del left[key]
            yield key, result

    def _next(self, finished: SimpleQueue[Future[Any]]) -> Future[Any]:
        while True:
            try:
                return finished.get(timeout=_PATIENCE)
            except Empty:
                if not self._alive():
                    raise NoSolutionError(f"no worker is left; {_ADVICE}") from None


class _InThisProcess:
    def run(self, function: Callable[..., Any], tasks: Iterable[tuple[int, Task]]) -> Iterator[tuple[int, Any]]:
        for key, task in tasks:
            yield key, function(*task)


@contextmanager
def workers(count: int = 1, scheduler: str | None = None) -> Iterator[Workers | _InThisProcess]:
    """One process (count 1), a pool of `count` processes, or the Dask cluster at `scheduler` (tcp://host:port).

    BadInputError when the count is not positive, Dask is not installed or the scheduler does not answer.
    """
    if count < 1:
        raise BadInputError(f"the number of workers is {count}; it must be at least 1")
    if scheduler is not None:
        with _dask_client(scheduler) as client:
            threads = sum(client.nthreads().values())
            if not threads:
                raise BadInputError(f"the Dask scheduler at {scheduler} has no workers; start some")
            yield Workers(
                lambda: client.get_executor(pure=False, retries=_MOST_DEATHS),
                threads,
                alive=lambda: bool(client.nthreads()),
                lost=_dask_losses(),
            )
    elif count == 1:
        yield _InThisProcess()
    else:
        with _pool(count) as make:
            yield Workers(make, count)


@contextmanager
def _pool(count: int) -> Iterator[Callable[[], Executor]]:
    """Makes pools of `count` processes, which end with this one, and at once where the block ends by an exception."""
    import multiprocessing

    # Not fork: CasADi and NumPy hold threads, which a forked child would inherit broken.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    never_closed: list[Any] = []

    def make() -> ProcessPoolExecutor:
        executor = ProcessPoolExecutor(count, mp_context=context, initializer=_end_with_parent)
        if sys.version_info < (3, 11, 5):  # its pools go on writing to workers that are gone
            never_closed.append(executor._call_queue._reader)  # type: ignore[attr-defined]
        return executor

    try:
        yield make
    except BaseException:
        ours = set(multiprocessing.active_children()) - others
        for process in ours:
            process.terminate()
        for process in ours:
            process.join(_GONE)
            process.kill()  # what computes for longer
        for pipe in never_closed:
            pipe.close()
        # The thread that looks after them closes its pipe once they are gone; an interpreter that ends meanwhile writes
        # into it, and says so.
        for thread in threading.enumerate():
            if type(thread).__module__ == "concurrent.futures.process":
                thread.join(_ENDED)
        raise


def _end_with_parent() -> None:
    """End this worker when the process that started it is gone, however that ended; on SIGTERM between two tasks.

    Half a message would keep the thread that reads it, and so the process that started this one, for ever.
    """
    import multiprocessing
    import signal

    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    signal.signal(signal.SIGTERM, lambda *_: _leaving.set())


def _worked(function: Callable[..., Any], *task: Any) -> Any:
    """`function(*task)`; a worker that is to end neither begins nor sends it."""
    result = None if _leaving.is_set() else function(*task)
    if _leaving.is_set():
        os._exit(1)
    return result


def _dask_losses() -> tuple[type[BaseException], ...]:
    """What a future raises when its task killed its workers, or the scheduler is gone."""
    from concurrent.futures import CancelledError

    from distributed.comm import CommClosedError
    from distributed.scheduler import KilledWorker

    return KilledWorker, CancelledError, CommClosedError


@contextmanager
def _dask_client(scheduler: str) -> Iterator[Any]:
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise BadInputError("--scheduler needs Dask; install it with `pip install .[distributed]`") from error
    try:
        client = Client(scheduler, timeout=_ANSWER)
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one, or use --workers"
        ) from error
    with _quiet("distributed"):
        try:
            yield client
        finally:
            client.close()


@contextmanager
def _quiet(package: str) -> Iterator[None]:
    """What a package logs in its own words and tracebacks is not said while the block runs: we say it in ours."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == package]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)
