"""A job in a store: the same bits wherever it runs, nothing lost to a kill, no damaged number taken
for right."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfa_support import BadInputError
from hfa_support.jobs import store as module
from hfa_support.jobs.store import Array, Layout, Store, create_store, described, open_store, stream

ROWS, CHUNK = 10, 3
NAN = float("nan")


def rows(start: int, stop: int) -> Mapping[str, np.ndarray]:
    """`empty` holds nothing but nan; `pole` is nan+0j in the rows of chunk 1, as where there is no
    trim."""
    numbers = np.arange(start, stop, dtype=float)
    pole = numbers * (1 + 2j)
    pole[(numbers >= 3) & (numbers < 6)] = complex(NAN, 0.0)
    empty = np.full(len(numbers), NAN)
    return {
        "square": np.outer(numbers**2, [1, 2]),
        "empty": empty,
        "pole": pole,
        "none": np.ones((len(numbers), 0)),
    }


def slow_rows(start: int, stop: int) -> Mapping[str, np.ndarray]:
    time.sleep(0.1)
    return rows(start, stop)


class Job:
    def __init__(self, seed: int = 0, function: Callable[..., Any] = rows) -> None:
        self.seed, self.function = seed, function

    @cached_property
    def layout(self) -> Layout:
        arrays = {
            "square": Array((2,), "float64", np.nan, ("side",), described("a square", "ft^2")),
            "empty": Array((), "float64", np.nan, (), {}),
            "pole": Array((), "complex128", complex(NAN, NAN), (), {}),
            "none": Array((0,), "float64", np.nan, ("nothing",), {}),
        }
        labels = {
            "side": ("side", ("left", "right")),
            "side_unit": ("side", ("ft", "rad")),
            "nothing": ("nothing", ()),
        }
        attributes = {"units": ["ft", "rad"]}
        return Layout(
            "test/1", "test", ROWS, "row", CHUNK, {"seed": self.seed}, arrays, labels, attributes
        )

    def task(self, start: int, stop: int) -> tuple[Any, ...]:
        return start, stop


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a store."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("store") / "a.zarr"
    stream(Job(), path)
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    """A finished store that a test may damage."""
    return shutil.copytree(made, tmp_path / "a.zarr")


def resumed(path: Path, **options: Any) -> Store:
    return stream(Job(), path, resume=True, **options)


def test_what_was_computed_is_read_in_any_slice(made: Path) -> None:
    store, expected = open_store(made), rows(0, ROWS)
    assert store.missing() == []
    for name, values in expected.items():
        np.testing.assert_array_equal(store.read(name), values)
    assert store.read("pole")[3:6].imag.tolist() == [0.0, 0.0, 0.0]
    for start in (-2, 0, 2, 3, 7, ROWS):
        for stop in (0, 3, 5, 6, ROWS + 1):
            np.testing.assert_array_equal(
                store.read("square", slice(start, stop)), expected["square"][start:stop]
            )


def test_two_processes_write_the_bytes_of_one_and_a_resume_changes_none(
    made: Path, tmp_path: Path
) -> None:
    """A chunk without a trim, nan+0j, was read back as nan+nanj, and so reported as damaged."""
    stream(Job(), tmp_path / "two.zarr", count=2)
    assert resumed(tmp_path / "two.zarr").missing() == []  # a warning would be an error
    assert contents(tmp_path / "two.zarr") == contents(made)


def test_a_dask_cluster_writes_the_bytes_of_one(made: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=4, processes=False, dashboard_address=":0"
    ) as known:
        stream(Job(), tmp_path / "far.zarr", scheduler=known.scheduler_address)
    assert contents(tmp_path / "far.zarr") == contents(made)


class Stop(Exception):
    pass


def test_only_what_is_missing_is_computed(made: Path, tmp_path: Path) -> None:
    def stop_after_two(done: int, _: int) -> None:
        if done == 2:
            raise Stop

    with pytest.raises(Stop):
        stream(Job(), tmp_path / "a.zarr", progress=stop_after_two)
    assert open_store(tmp_path / "a.zarr").missing() == [2, 3]
    seen = list[tuple[int, int]]()
    resumed(tmp_path / "a.zarr", progress=lambda *now: seen.append(now))
    assert seen == [(2, 4), (3, 4), (4, 4)]  # the first before anything is computed
    assert contents(tmp_path / "a.zarr") == contents(made)


KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import test_store
if __name__ == "__main__":
    test_store.stream(test_store.Job(function=test_store.slow_rows), Path("a.zarr"), count=2)
"""


def test_a_kill_leaves_whole_chunks_and_an_honest_list(made: Path, tmp_path: Path) -> None:
    (tmp_path / "killed.py").write_text(KILLED)
    words = [sys.executable, "killed.py", str(Path(__file__).parent)]
    process = subprocess.Popen(
        words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    )
    path, deadline = tmp_path / "a.zarr", time.monotonic() + 60
    while time.monotonic() < deadline and not list(path.glob("done/c/*")):
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    left = open_store(path)
    assert 0 < len(left.missing()) < 4
    assert left.damaged() == []
    resumed(path)
    kept = {
        name: content for name, content in contents(path).items() if not name.endswith(".partial")
    }
    assert kept == contents(made)


def _flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(bytes(content))


@pytest.mark.parametrize(
    "damage", [_flip, Path.unlink, lambda file: file.write_bytes(b"")], ids=["flip", "gone", "cut"]
)
@pytest.mark.parametrize("file", ["square/c/1/0", "empty/c/1", "pole/c/1", "done/c/1"])
def test_a_damaged_chunk_is_noticed_and_computed_again(
    made: Path, path: Path, file: str, damage: Callable[[Path], None]
) -> None:
    damage(path / file)
    store, array = open_store(path), file.split("/")[0]
    if array == "done":
        assert store.missing() == [1]
        resumed(path)
    else:
        assert (store.missing(), store.damaged()) == ([], [1])
        with pytest.raises(
            BadInputError, match=rf"{array} is damaged; compute it again with --resume"
        ):
            store.read(array)
        np.testing.assert_array_equal(store.read(array, slice(6, 10)), rows(6, 10)[array])
        with pytest.warns(UserWarning, match="1 of 4 chunks were damaged and are computed again"):
            resumed(path)
    assert contents(path) == contents(made)


def test_every_bit_of_every_file_counts(made: Path, tmp_path: Path) -> None:
    """Names, units and attributes too: a store with one flipped bit is refused, or its chunk is
    computed again."""
    whole, rng, outcomes = contents(made), np.random.default_rng(1), {"refused": 0, "computed": 0}
    path = shutil.copytree(made, tmp_path / "a.zarr")
    for name, content in sorted(whole.items()):
        for bit in rng.integers(8 * len(content), size=2):
            flipped = bytearray(content)
            flipped[bit // 8] ^= 1 << int(bit % 8)
            (path / name).write_bytes(bytes(flipped))
            try:
                store = open_store(path, Job().layout)
                assert store.missing() + store.damaged(), (name, bit)
                outcomes["computed"] += 1
            except BadInputError:
                outcomes["refused"] += 1
            (path / name).write_bytes(content)
    described = (
        11  # zarr.json of the store and of seven arrays, names and units of an axis, the digest
    )
    assert outcomes == {"refused": 2 * described, "computed": 2 * (len(whole) - described)}


def test_a_store_is_neither_overwritten_nor_continued_by_another_job(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(BadInputError, match="exists; continue it with --resume"):
        stream(Job(), path)
    with pytest.raises(BadInputError, match="belongs to another test"):
        stream(Job(seed=1), path, resume=True)
    (tmp_path / "old.zarr").mkdir()
    for name in ("none.zarr", "old.zarr"):
        with pytest.raises(BadInputError, match="not a test store of this version"):
            stream(Job(), tmp_path / name, resume=True)
    monkeypatch.setattr(module, "VERSION", "0.0.9")
    with pytest.raises(BadInputError, match=r"was begun by version \d.* and this is 0\.0\.9"):
        stream(Job(), path, resume=True)
    assert open_store(path).missing() == []  # any version reads it


def test_a_store_appears_whole_and_takes_no_folder_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder such as .a.zarr.my-backup-202612 was taken for a leftover of a killed run and
    removed."""
    (tmp_path / ".a.zarr.my-backup-202612").mkdir()
    (tmp_path / ".a.zarr.0123456789abcdef").mkdir()
    theirs = set(tmp_path.iterdir())

    def broken(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(module, "_fill", broken)
        with pytest.raises(OSError, match="No space left"):
            create_store(tmp_path / "a.zarr", Job().layout)
    assert set(tmp_path.iterdir()) == theirs
    create_store(tmp_path / "a.zarr", Job().layout)
    assert set(tmp_path.iterdir()) == {*theirs, tmp_path / "a.zarr"}
