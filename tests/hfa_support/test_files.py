"""Files that are read: regular, of limited size, never overwritten. Files are written whole."""

import errno
import io
import os
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa as run
from game_files import small, stored
from project import ROOT

import hfa

pytestmark = pytest.mark.usefixtures("folder")
AT_15 = ("--dihedral", "15")
#: A result that can be saved.
SOLUTION = hfa.solve(hfa.Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0]))
NO_TEXT = ("is not a TOML file", "is not JSON")
NO_FILE = "no parameters and no readable file of this name"
#: Fault -> call that makes the file; reason of `hfa trim` that it is no file of parameters; reason
#: of `hfa verify` that it is no critic.
UNREADABLE = {
    "fifo": (os.mkfifo, NO_FILE, "not a regular file"),
    "large": (
        lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_RDWR), 2**28 + 1),
        NO_FILE,
        "larger than 256 MiB",
    ),
    "a folder": (os.mkdir, NO_FILE, "the folder contains no critic"),
    "missing": (lambda path: None, NO_FILE, "no such file"),
    "nested": (lambda path: Path(path).write_bytes(b"[" * 100_000), *NO_TEXT),
    "long number": (lambda path: Path(path).write_bytes(b"9" * 5000), *NO_TEXT),
    "deep key": (
        lambda path: Path(path).write_bytes(b"a" + b".a" * 30_000 + b" = 1"),
        "more than 150 parts",
        "is not JSON",
    ),
    "a device": (lambda path: os.symlink("/dev/zero", path), NO_FILE, "not a regular file"),
    "not UTF-8": (lambda path: Path(path).write_bytes(b"\xff\xfe\xff"), *NO_TEXT),
}


@pytest.mark.parametrize("fault", UNREADABLE)
@pytest.mark.parametrize("command", ["trim", "verify"])
def test_an_unreadable_file_is_refused(fault, command):
    """A file of parameters or a critic that is a FIFO, a folder, large, missing or damaged is
    refused in one line that names the file and the reason, without blocking.
    """
    make, reason_of_trim, reason_of_verify = UNREADABLE[fault]
    option, name, reason = {
        "trim": ("--parameters", "a.toml", reason_of_trim),
        "verify": ("--weights", "a.json", reason_of_verify),
    }[command]
    make(name)
    assert_refused(run(command, *AT_15, option, name), 2, name, reason)


def zipped(name="K.npy", content=b"text", method=zipfile.ZIP_DEFLATED):
    """Return the bytes of a zip file with one member."""
    with zipfile.ZipFile(stream := io.BytesIO(), "w", method) as archive:
        archive.writestr(name, content)
    return bytearray(stream.getvalue())


def damaged_zip():
    """Return a zip file whose compressed data have a wrong bit."""
    content = zipped(content=bytes(range(256)) * 40)
    content[40] ^= 0xFF  # after the header of the member, which has 36 bytes
    return content


def encrypted_zip():
    """Return a zip file whose member is said to be encrypted."""
    content = zipped()
    content[6] |= 1  # flag in the header of the member, and in the directory of the file
    content[content.index(b"PK\x01\x02") + 8] |= 1
    return content


#: Fault -> function that returns the bytes of the file, and the reason of the refusal; the last
#: file is a zip file without fault, and has none of the expected members.
ZIPS = {
    "damaged": (damaged_zip, "not a readable zip"),
    "encrypted": (encrypted_zip, "password"),
    "cut": (lambda: zipped()[:40], "not a readable zip"),
    "deep": (lambda: zipped("a/" * 2500 + "b"), "folders"),
    "outside": (lambda: zipped("../b"), "outside"),
    "other method": (lambda: zipped(method=zipfile.ZIP_BZIP2), "deflate"),
    "large": (lambda: zipped(content=bytes(2**28 + 1)), "more than 256 MiB"),
    "a file in a file": (lambda: zipped("a" * 300 + "/b"), ""),
}


@pytest.mark.parametrize(
    "fault",
    [*(fault for fault in ZIPS if fault != "large"), pytest.param("large", marks=pytest.mark.slow)],
)
def test_a_faulty_zip_file_is_refused_in_one_line(fault):
    """A zip file with a fault is refused with the same reason as an FMU (an aircraft), as .npz
    (arrays of a critic), and as a network (.pt, .zip), which are all zip files.
    """
    make, reason = ZIPS[fault]
    for name in ("a.fmu", "a.npz", "a.pt", "a.zip"):
        Path(name).write_bytes(make())
        words = ("trim", "--aircraft") if name == "a.fmu" else ("verify", *AT_15, "--weights")
        assert_refused(run(*words, name), 2, name, reason)


@pytest.mark.parametrize("is_named", [False, True])
def test_a_full_disk_is_reported_with_the_name_of_the_output(monkeypatch, is_named):
    """If the disk is full when an output is stored, the message names the output, and no file
    remains. The system's error is raised where the temporary file is renamed to the output.

    is_named: whether the system's error names the temporary file, which a user has not given
    """

    def full(temporary, _):
        names = (str(temporary),) if is_named else ()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), *names)

    monkeypatch.setattr(Path, "replace", full)
    assert_refused(run("trim", *AT_15, "-o", "trim.json"), 2, "trim.json")
    assert os.listdir() == []


INPUT = "is an input of this run; name another file"


@pytest.mark.parametrize(
    ("words", "kept", "said"),
    [
        ("solve --model A.csv --Q 1,1 --R 1 --delta inf -o B.csv", "B.csv", INPUT),
        ("solve --model link.csv --Q 1,1 --R 1 --delta inf -o ./A.csv", "A.csv", INPUT),
        ("solve --model A.csv --Q 1,1 --R 1 --delta inf -o link.csv", "A.csv", INPUT),
        ("verify --model plant.json --weights a.json -o a.json", "a.json", INPUT),
        ("trim --aircraft navion.py:NAVION --picture link.svg", "navion.py", INPUT),
        ("solve --model=plant.json --output=plant.json", "plant.json", INPUT),
        (
            "trim --dihedral 15 -o kept.pdf --picture=./kept.pdf",
            "kept.pdf",
            "is given for two outputs",
        ),
        ("trim --dihedral 15 -o fifo.json", "plant.json", "is not a regular file"),
    ],
)
def test_an_output_replaces_no_input(words, kept, said):
    """An output is refused that is an input of the run, also through a link or another path, or
    another output, or not a regular file. All files remain as they were.

    `--model A.csv` reads B.csv beside it, too. link.csv and link.svg are links to A.csv and
    navion.py.
    kept: file whose content is compared
    """
    np.savetxt("A.csv", [[0.0, 1.0], [-1.0, -1.0]], delimiter=",")
    np.savetxt("B.csv", [[0.0], [1.0]], delimiter=",")
    Path("link.csv").symlink_to("A.csv")
    os.mkfifo("fifo.json")
    small("plant.json")
    stored("a.json", W=np.ones(3))
    shutil.copy(ROOT / "examples" / "navion.py", ".")
    Path("link.svg").symlink_to("navion.py")
    Path("kept.pdf").write_bytes(b"a report")
    before = Path(kept).read_bytes()
    names = set(Path().iterdir())
    assert_refused(run(*words.split()), 2, said)
    assert (Path(kept).read_bytes(), set(Path().iterdir())) == (before, names)


def test_an_interrupted_write_keeps_the_old_file(monkeypatch):
    """If writing is interrupted, the old file remains, and no temporary file is left."""
    SOLUTION.save("kept.npz")
    before = Path("kept.npz").read_bytes()

    def broken(stream, **arrays):
        stream.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", broken)  # as Ctrl-C does after the first bytes
    with pytest.raises(KeyboardInterrupt):
        SOLUTION.save("kept.npz")
    assert Path("kept.npz").read_bytes() == before
    assert [entry.name for entry in Path().iterdir()] == ["kept.npz"]


def test_a_replaced_file_keeps_its_permissions():
    """A file with the permissions 640, not those of a new file, keeps them when it is replaced."""
    Path("kept.npz").touch()
    Path("kept.npz").chmod(0o640)
    SOLUTION.save("kept.npz")
    assert Path("kept.npz").stat().st_mode & 0o777 == 0o640
