"""What a store says of itself is held against what it holds: no damaged number is taken for right."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from functools import cached_property, reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfa_support import BadInputError
from hfa_support.jobs import store
from hfa_support.jobs.layout import Array, Layout, described
from hfa_support.jobs.store import checksum, open_store
from hfa_support.jobs.stream import stream

ROWS, CHUNK = 10, 3


def squares(start: int, stop: int) -> Mapping[str, np.ndarray]:
    """`empty` holds nothing but nan, of either sign: Zarr keeps no file of it."""
    numbers = np.arange(start, stop, dtype=float)
    return {"square": np.outer(numbers, numbers[:1] ** 0 * [1, 2]), "empty": -np.full(len(numbers), np.nan)}


class Job:
    @cached_property
    def layout(self) -> Layout:
        arrays = {
            "square": Array((2,), "float64", np.nan, ("side",), described("a square", "ft^2")),
            "empty": Array((), "float64", np.nan, (), {}),
        }
        labels = {"side": ("side", ("left", "right")), "nothing": ("nothing", ())}
        units = {"units": ["ft", "rad"]}
        return Layout("test/1", "test", ROWS, "row", CHUNK, {"rows": ROWS}, "same", arrays, labels, units)

    function = staticmethod(squares)

    def task(self, start: int, stop: int) -> tuple[Any, ...]:
        return start, stop


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("store")
    stream(Job(), folder / "a.zarr")
    return folder / "a.zarr"


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    """A finished store that a test may damage."""
    return shutil.copytree(made, tmp_path / "a.zarr")


def _flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    file.write_bytes(bytes(content))


@pytest.mark.parametrize(
    "damage", [_flip, Path.unlink, lambda file: file.write_bytes(b"")], ids=["flip", "gone", "cut"]
)
@pytest.mark.parametrize("file", ["square/c/1/0", "checksums/c/1/0"])
def test_a_damaged_chunk_is_noticed_and_computed_again(path: Path, file: str, damage) -> None:
    expected = open_store(path).read("square")
    damage(path / file)
    assert open_store(path).damaged() == [1]
    with pytest.raises(BadInputError, match=r"is damaged in chunk 1; compute it again with --resume"):
        [open_store(path).read(name) for name in ("square", "empty")]
    np.testing.assert_array_equal(open_store(path).read("square", slice(6, 10)), expected[6:10])
    with pytest.warns(UserWarning, match="1 of 4 chunks were damaged and are computed again"):
        store = stream(Job(), path, resume=True)
    np.testing.assert_array_equal(store.read("square"), expected)
    assert stream(Job(), path, resume=True).damaged() == []


def test_a_whole_store_is_read_in_any_slice(path: Path) -> None:
    store, expected = open_store(path), squares(0, ROWS)["square"]
    for start in range(ROWS + 1):
        for stop in range(ROWS + 2):
            np.testing.assert_array_equal(store.read("square", slice(start, stop)), expected[start:stop])
    np.testing.assert_array_equal(store.read("square", slice(-2, None)), expected[-2:])


def test_a_flag_that_cannot_be_read_is_a_chunk_to_compute(path: Path) -> None:
    (path / "done" / "c" / "2").write_bytes(b"\0\1\2")
    assert open_store(path).missing() == [2]
    with pytest.warns(UserWarning, match="1 of 4 chunks"):
        assert stream(Job(), path, resume=True).missing() == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda attributes: attributes.update(units=["ft", "deg"]), "attributes or the forms"),
        (lambda attributes: attributes.update(chunk=5), "attributes or the forms"),
        (lambda attributes: attributes.pop("schema"), "attributes or the forms"),
        (lambda attributes: attributes.pop("checksum"), "has no checksums"),
        (lambda attributes: attributes.pop("identity"), "is not a .*store of this project"),
    ],
)
@pytest.mark.parametrize("layout", [None, Job().layout], ids=["read", "continued"])
def test_damaged_attributes_are_refused(path: Path, change, said: str, layout: Layout | None) -> None:
    file = path / "zarr.json"
    data = json.loads(file.read_text())
    change(data["attributes"])
    file.write_text(json.dumps(data))
    with pytest.raises(BadInputError, match=said):
        open_store(path, layout)


@pytest.mark.parametrize("file", ["zarr.json", "square/zarr.json", "done/zarr.json"])
@pytest.mark.parametrize("content", [b"", b"{}", b"\xff{", b'{"zarr_format": 3}'])
def test_damaged_descriptions_are_refused(path: Path, file: str, content: bytes) -> None:
    (path / file).write_bytes(content)
    with pytest.raises(BadInputError, match=r"damaged|is not a test store"):
        open_store(path, Job().layout)


@pytest.mark.parametrize("array", ["square", "done", "checksums"])
@pytest.mark.parametrize(
    ("entry", "value"),
    [
        (("shape", 0), 999999999999),
        (("chunk_grid", "configuration", "chunk_shape", 0), 7),
        (("data_type",), "float32"),
        (("dimension_names", 0), "another"),
        (("fill_value",), 1),
    ],
)
def test_an_array_of_another_form_is_refused(path: Path, array: str, entry: tuple, value: object) -> None:
    file = path / array / "zarr.json"
    changed = json.loads(file.read_text())
    *way, last = entry
    reduce(getitem, way, changed)[last] = value
    file.write_text(json.dumps(changed))
    with pytest.raises(BadInputError, match="the forms of its arrays"):
        open_store(path)


def test_the_checksum_sees_every_bit_but_the_kind_of_nan() -> None:
    values = np.array([1.0, -0.0, np.inf])
    sums = {checksum(values)}
    for bit in range(64 * values.size):
        flipped = values.copy().view(np.uint64)
        flipped[bit // 64] ^= np.uint64(1 << bit % 64)
        sums.add(checksum(flipped.view(float)))
    assert len(sums) == 1 + 64 * values.size - 51  # inf with any bit of its mantissa is nan
    assert checksum(np.array([np.nan])) == checksum(-np.array([np.nan]))


def test_one_run_at_a_time_writes_into_a_store(path: Path) -> None:
    with (
        open_store(path, Job().layout).session(),
        pytest.raises(BadInputError, match="another run writes into it; wait for its end"),
    ):
        stream(Job(), path, resume=True)
    stream(Job(), path, resume=True)


def test_a_store_appears_whole_and_never_over_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise OSError(28, "No space left on device")

    fill = store._fill
    monkeypatch.setattr(store, "_fill", broken)
    with pytest.raises(OSError, match="No space left"):
        stream(Job(), tmp_path / "a.zarr")
    assert list(tmp_path.iterdir()) == []

    def overtaken(*given: Any) -> None:
        monkeypatch.setattr(store, "_fill", fill)
        stream(Job(), tmp_path / "a.zarr")
        fill(*given)

    monkeypatch.setattr(store, "_fill", overtaken)
    with pytest.raises(BadInputError, match="exists; continue it with --resume"):
        stream(Job(), tmp_path / "a.zarr")
    assert open_store(tmp_path / "a.zarr").missing() == []
    assert [each.name for each in tmp_path.iterdir()] == ["a.zarr"]
