"""Workers that die: what is lost is run again, what cannot be run is said in one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import CancelledError, Executor, Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import pytest

from hfa_support import BadInputError, NoSolutionError
from hfa_support.jobs import workers as executors
from hfa_support.jobs.workers import Workers


class _Scripted(Executor):
    """Answers at once; `answers` says with what: a value, an exception, or nothing at all (None)."""

    def __init__(self, answers: list[Any]) -> None:
        self._answers = answers

    def submit(self, function: Any, /, *task: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        answer = self._answers.pop(0) if self._answers else 0
        if isinstance(answer, BaseException):
            future.set_exception(answer)
        elif answer is not None:
            future.set_result(answer)
        return future


def _run(answers: list[Any], tasks: int, **options: Any) -> dict[int, Any]:
    crew = Workers(lambda: _Scripted(answers), 1, **options)
    return dict(crew.run(abs, [(number, (number,)) for number in range(tasks)]))


def _deaths(number: int) -> list[Any]:
    return [BrokenProcessPool("killed") for _ in range(number)]


def test_deaths_with_results_between_them_do_not_end_a_long_job() -> None:
    # Two tasks are in flight: a death takes the next one with it, so that each is handed out again.
    answers = [1, *_deaths(1), 2, 3, *_deaths(1), 4, 5, *_deaths(1), 6, 7, *_deaths(1)]
    assert sorted(_run(answers, 12)) == list(range(12))


def test_deaths_with_nothing_between_them_end_the_job() -> None:
    with pytest.raises(NoSolutionError, match="workers died 3 times in a row"):
        _run([value for _ in range(3) for value in (*_deaths(1), None)], 4)


def test_a_chunk_that_the_cluster_gave_up_is_one_line() -> None:
    with pytest.raises(NoSolutionError, match=r"gave a chunk up \(CancelledError\)") as raised:
        _run([CancelledError()], 2, lost=(CancelledError,))
    assert "\n" not in str(raised.value)


def test_waiting_for_workers_that_are_gone_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "_PATIENCE", 0.01)
    asked = []
    with pytest.raises(NoSolutionError, match="no worker is left"):
        _run([None, None], 2, alive=lambda: len(asked) < 3 and asked.append(1) is None)
    assert len(asked) == 3


def _die(_: int) -> None:
    os._exit(1)


def test_a_task_that_kills_the_workers_of_a_cluster_is_one_line() -> None:
    dask, distributed = pytest.importorskip("dask"), pytest.importorskip("distributed")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),  # it gives up after one worker, not four
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster,
        executors.workers(scheduler=cluster.scheduler_address) as crew,
    ):
        assert dict(crew.run(abs, [(key, (-key,)) for key in range(5)])) == {key: key for key in range(5)}
        with pytest.raises(NoSolutionError, match="gave a chunk up"):
            list(crew.run(_die, [(0, (0,))]))


def test_a_scheduler_that_does_not_answer_is_bad_input(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "_ANSWER", "0.1s")
    with pytest.raises(BadInputError, match="no Dask scheduler answers"), executors._dask_client("tcp://127.0.0.1:9"):
        pass


def _die_once(flag: str, value: int) -> int:
    """Kill this very process the first time that value 3 comes along."""
    if value == 3 and not os.path.exists(flag):
        with open(flag, "w"):
            pass
        os.kill(os.getpid(), signal.SIGKILL)
    return value * value


def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    crew = Workers(lambda: ProcessPoolExecutor(2, mp_context=get_context("spawn")), 2)
    flag = str(tmp_path / "died")
    results = dict(crew.run(_die_once, [(value, (flag, value)) for value in range(8)]))
    assert os.path.exists(flag)
    assert results == {value: value * value for value in range(8)}


#: Leaves the pool while its workers send 24 MB each, after some time; the process then waits for its threads.
_LEAVES = """
import sys, time
import numpy as np
from hfa_support.jobs.workers import workers

if __name__ == "__main__":
    for moment in map(float, sys.argv[1:]):
        try:
            with workers(2) as pool:
                for key, _ in pool.run(np.zeros, ((k, (3_000_000,)) for k in range(1000))):
                    if key == 6:
                        time.sleep(moment)
                        raise KeyboardInterrupt
        except KeyboardInterrupt:
            print("left")
"""


@pytest.mark.parametrize("moments", [("0", "0.03"), pytest.param(("0.01", "0.05"), marks=pytest.mark.slow)])
def test_a_pool_that_is_left_while_its_workers_send_ends(tmp_path: Path, moments: tuple[str, ...]) -> None:
    """Half a message would keep the thread that reads it for ever."""
    (tmp_path / "leaves.py").write_text(_LEAVES, encoding="utf-8")
    words = [sys.executable, "leaves.py", *moments]
    run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=30.0, check=True)
    assert (run.stdout, run.stderr) == (len(moments) * "left\n", "")
