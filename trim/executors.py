"""Where the chunks of a sweep run: this process, a pool of processes, or a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

from hfa_model.errors import BadInputError, NoSolutionError

#: Chunks in flight for each worker: enough to keep it busy, few enough to keep memory flat.
_AHEAD = 2
#: A chunk that takes its worker down this often is not run again.
_MOST_DEATHS = 3

Task = tuple[Any, ...]


class Workers:
    """Runs `function(*task)` for many tasks and yields (key, result) as they finish."""

    def __init__(self, make: Callable[[], Executor], count: int) -> None:
        self._make, self._count = make, count

    def run(self, function: Callable[..., Any], tasks: Iterable[tuple[int, Task]]) -> Iterator[tuple[int, Any]]:
        """Results in the order in which they finish. Tasks of a worker that died are run again on new workers.

        NoSolutionError when a chunk kills its worker repeatedly.
        """
        waiting = iter(tasks)
        left: dict[int, Task] = {}
        deaths = 0
        while True:
            executor = self._make()
            try:
                yield from self._run(executor, function, waiting, left)
                return
            except BrokenProcessPool as error:
                deaths += 1
                if deaths >= _MOST_DEATHS:
                    raise NoSolutionError(f"workers died {deaths} times; see the system's log, or use fewer") from error
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
            future = executor.submit(function, *task)
            futures[future] = key
            future.add_done_callback(finished.put)

        try:
            for key, task in left.items():
                submit(key, task)
            while True:
                while len(futures) < _AHEAD * self._count and (item := next(waiting, None)) is not None:
                    left[item[0]] = item[1]
                    submit(*item)
                if not futures:
                    return
                future = finished.get()
                result = future.result()
                key = futures.pop(future)
                del left[key]
                yield key, result
        finally:
            for future in futures:
                future.cancel()


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
            cores = sum(client.nthreads().values())
            if not cores:
                raise BadInputError(f"the Dask scheduler at {scheduler} has no workers; start some")
            yield Workers(lambda: client.get_executor(pure=False, retries=_MOST_DEATHS), cores)
    elif count == 1:
        yield _InThisProcess()
    else:
        import multiprocessing

        # Not fork: CasADi and NumPy hold threads, which a forked child would inherit broken.
        context = multiprocessing.get_context("spawn")
        yield Workers(lambda: ProcessPoolExecutor(count, mp_context=context), count)


@contextmanager
def _dask_client(scheduler: str) -> Iterator[Any]:
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise BadInputError("--scheduler needs Dask; install it with `pip install .[distributed]`") from error
    try:
        client = Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise BadInputError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one, or use --workers"
        ) from error
    try:
        yield client
    finally:
        client.close()
