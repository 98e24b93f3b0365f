"""Jobs in a store: equal bits, killed runs, damaged chunks and metadata."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from hfa import BadInputError
from hfa_support.rows.store import RowJob, fill_store, open_store, template_variable

#: The jobs of these tests have 10 rows in 4 chunks: rows 0 to 2, 3 to 5, 6 to 8, and 9.
ROWS = 10
CHUNK = 3
NAN = float("nan")


def numbers(start, stop):
    """Return the arrays of a job for rows start .. stop - 1.

    `empty` contains only fill values. `pole` is nan+0j in the second chunk, which is not the fill
    value nan+nanj, as for a point without a trim.
    """
    count = np.arange(start, stop, dtype=float)
    pole = count * (1 + 2j)
    pole[(count >= 3) & (count < 6)] = complex(NAN, 0.0)
    return {
        "square": np.outer(count**2, [1, 2]),
        "empty": np.full(len(count), NAN),
        "pole": pole,
        "not in the store": np.zeros(len(count)),
    }


def row_job(seed=0):
    """Return a job of 10 rows in 4 chunks; another seed makes it another job."""
    import xarray

    arrays = {
        "square": template_variable(("row", "side"), (ROWS, 2), NAN, CHUNK, {"units": "ft"}),
        "empty": template_variable(("row",), (ROWS,), NAN, CHUNK, {}),
        "pole": template_variable(("row",), (ROWS,), complex(NAN, NAN), CHUNK, {}),
    }
    sides = {"side": np.array(["left", "right"], dtype=object)}
    attributes = {"schema": "test/1", "plan": {"seed": seed}}
    template = xarray.Dataset(arrays, sides, attributes)
    return RowJob("test", "row", template, numbers, lambda start, stop: (start, stop))


def contents(folder):
    """Return the bytes of each file in a store by name."""
    files = [file for file in folder.rglob("*") if file.is_file()]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def finished_store(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "a.zarr"
    fill_store(row_job(), path)
    return path


@pytest.fixture
def path(finished_store, tmp_path):
    """Return a copy of a finished store, which a test may damage."""
    return shutil.copytree(finished_store, tmp_path / "a.zarr")


def resumed(path):
    """Resume a store, and return the reported progress as (chunks done, total chunks)."""
    told = []
    fill_store(row_job(), path, resume=True, progress=lambda *now: told.append(now))
    return told


def test_only_missing_rows_are_computed(finished_store, tmp_path):
    """A job that ends after two of four chunks computes the other two when it is resumed, and ends
    with the bytes of an uninterrupted one.
    """

    def stop_after_two(done, _):
        if done == 2:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        fill_store(row_job(), tmp_path / "a.zarr", progress=stop_after_two)
    assert np.isnan(open_store(tmp_path / "a.zarr").square.values[6:]).all()
    # Progress is reported at the start, and after each computed chunk.
    assert resumed(tmp_path / "a.zarr") == [(2, 4), (3, 4), (4, 4)]
    assert contents(tmp_path / "a.zarr") == contents(finished_store)


def _flip(file):
    """Change a bit in the middle of a file."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize(
    "file",
    ["square/c/1/0", "empty/c/1", "pole/c/1"],
)
@pytest.mark.parametrize(
    ("damage", "noticed"),
    [(_flip, True), (lambda file: file.write_bytes(b""), True), (Path.unlink, False)],
    ids=["flip", "cut", "gone"],
)
def test_a_damaged_chunk_is_computed_again(finished_store, path, file, damage, noticed):
    """A chunk with a changed bit, an empty one and a deleted one are computed again when the store
    is resumed, which has the same bytes as before the damage.

    noticed: whether reading the chunk raises an error and resuming warns: not of a deleted chunk,
      which is the same as one that is not yet computed
    """
    damage(path / file)
    if noticed:
        with pytest.raises(ValueError, match="computed checksum do not match"):
            open_store(path)[file.split("/")[0]].load()
        with pytest.warns(UserWarning, match="1 of 4 chunks were damaged and are computed again"):
            assert resumed(path) == [(3, 4), (4, 4)]
    else:
        assert resumed(path) == [(3, 4), (4, 4)]
    assert contents(path) == contents(finished_store)


@pytest.mark.parametrize("file", ["square/zarr.json", "side/c/0"])
def test_a_store_with_damaged_names_or_units_is_refused(path, file):
    """A store with a changed unit of `square`, or a changed bit in the names of its columns, is not
    resumed.
    """
    content = (path / file).read_bytes()
    (path / file).write_bytes(content.replace(b'"ft"', b'"kt"'))
    if content == (path / file).read_bytes():
        _flip(path / file)
    with pytest.raises(BadInputError, match="damaged"):
        fill_store(row_job(), path, resume=True)


def set_attributes(path, **attributes):
    """Change attributes of a store."""
    content = json.loads((path / "zarr.json").read_text())
    content["attributes"] |= attributes
    (path / "zarr.json").write_text(json.dumps(content))


def test_an_existing_store_is_not_overwritten(path):
    """A new job at the path of a store is refused with advice to resume it."""
    with pytest.raises(BadInputError, match="already exists; continue this store with --resume"):
        fill_store(row_job(), path)


def test_a_store_is_not_continued_by_another_job(path):
    """A complete store is not resumed by a job with another seed, which has arrays of equal size."""
    with pytest.raises(BadInputError, match="is the store of another test"):
        fill_store(row_job(seed=1), path, resume=True)


def test_only_stores_of_this_schema_are_continued(path, tmp_path):
    """A missing store, an empty folder and a store of another schema cannot be resumed."""
    (tmp_path / "empty.zarr").mkdir()
    set_attributes(path, schema="test/0")  # that of `row_job` is test/1
    for name in ("none.zarr", "empty.zarr", path.name):
        with pytest.raises(BadInputError, match="not a test store of this version"):
            fill_store(row_job(), tmp_path / name, resume=True)


def test_a_store_of_another_version_is_read_and_not_continued(path):
    """A store that another version of the code has begun is not resumed, and can be read."""
    set_attributes(path, toolchain="0.0.9")
    with pytest.raises(BadInputError, match=r"was started by version 0\.0\.9, but this is \d"):
        fill_store(row_job(), path, resume=True)
    assert open_store(path).square.shape == (ROWS, 2)


# Stores from untrusted sources.


def test_a_link_out_of_a_store_is_refused(path, tmp_path):
    """A store whose chunks are in a folder elsewhere, by a symbolic link, is refused."""
    (path / "square" / "c").rename(tmp_path / "elsewhere")
    (path / "square" / "c").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BadInputError, match="'square/c' differs from the store of this test"):
        fill_store(row_job(), path, resume=True)
