"""Refused requests give exit code 1 or 2 and one line with cause and remedy, and write no file."""

import shlex
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import small, stored

from hfa.entry_points import commands
from hfa.main import BAD_INPUT

#: A number too long for a double, and for a message.
DIGITS = "9" * 5000
F16 = f"{Path(__file__).parents[2] / 'examples/f16.py'}:F16"


def snapshot(folder):
    """Return path -> content for everything below a folder. The content of a folder is None."""
    return {
        str(path): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture(autouse=True)
def untouched(tmp_path):
    """Create files and folders before a test, and assert afterwards that they are unchanged.

    Files named `given...`, which the test creates, are ignored.
    """
    for name in ("folder.json", "folder.png", "folder.html"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").write_text("a file", encoding="utf-8")
    before = snapshot(tmp_path)
    yield
    after = {
        path: content
        for path, content in snapshot(tmp_path).items()
        if not Path(path).name.startswith("given")
    }
    assert after == before


#: Command -> its words, and a part of the message.
REFUSED = {
    "trim": [
        ("", "no value of dihedral is given; add --dihedral DEG"),
        ("--conditions given.csv --show alpha", "--show is of a single trim"),
        (
            "--dihedral 15 --hold Sped=68",
            "unknown trim variable 'Sped'; did you mean speed? choose from",
        ),
        ("--\x1b[31m", "unknown option --\\x1b[31m"),
        (f"--dihedral {DIGITS}", "--dihedral is '9999"),
        (
            "--dihedral 15 --parameters folder.json",
            "no parameters and no readable file of this name",
        ),
        (f"--aircraft {F16} --hold speed=3,4", "speed is 3 ft/s; give a value between"),
        ("--dihedral 15 --hold dihedral=10", "dihedral is given by both --dihedral and --hold"),
    ],
    "linearize": [
        ("--conditions given.csv --bode -o a.npz", "--bode is of a single condition"),
        ("--dihedral 95", "dihedral is 95 deg"),
        (
            "--dihedral 0:20:1",
            "dihedral has 21 values; give one (`hfa trim` and `hfa sweep` take several)",
        ),
        (
            "--dihedral 15 --dynamics aristotle",
            "unknown dynamics 'aristotle'; choose from published, newton",
        ),
        (
            "--dihedral 15 --outputs lift_centre",
            "unknown output 'lift_centre'; did you mean lift_center? choose from speed, alpha",
        ),
        ("--dihedral 15 -o folder.json", "folder.json is a folder"),
    ],
    "sweep": [
        ("--dihedral 5 -o result.xyz", "the suffix '.xyz' is unknown; use .json"),
        ("--dihedral 5 -o folder.json", "folder.json is a folder; choose another name"),
        ("", "no variable is swept; give --dihedral RANGE"),
        ("--dihedral 0:20:1 --resume", "--resume requires a store"),
        ("--conditions given.csv", "`hfa trim --conditions FILE` trims them"),
        ("--aircraft wing.avl --hold speed=9", "give the stability derivatives that AVL"),
        ("--dihedral 0:20:0.01 --hold speed=50:80:0.01", "the sweep has 6,005,001 points (maximum"),
        (
            f"--aircraft {F16} --hold mach=.5 --hold speed=400,500",
            "mach and speed are both imposed",
        ),
    ],
    "solve": [
        ("", "no plant is given; add --dihedral DEG, --aircraft FILE or --model FILE"),
        ("--dihedral 15 --delta 0", "delta is 0.0; give a number from"),
        (
            "--dihedral 15 --R 100,400,400,400,0",
            "R is not positive definite, or its diagonal has a smaller entry",
        ),
        (
            "--model given.json --hold speed=70",
            "--hold applies only to the aircraft; remove this option or --model",
        ),
        ("--dihedral 10,10 -o a.npz", "--dihedral does not increase"),
        ("--dihedral 5,10 --order 3", "--order applies to one trim"),
        ("--model given.json --order 3", "--order applies to one trim of an aircraft"),
        ("--dihedral 15 --rate 50 --order 3", "--order applies to one trim of an aircraft"),
        ("--dihedral 15 --reference speeds=7", "did you mean speed"),
        ("--dihedral 15 --reference speed=exp(t)", "write sums of terms"),
    ],
    "learn": [
        ("--dihedral 15 --law sarsa", "--law is 'sarsa'; choose from policy-iteration"),
        ("--dihedral 15 --rate 50 --law policy-iteration", "--law applies only to continuous time"),
        ("--dihedral 15 --data given.csv --seed 1", "--seed applies only to simulated data"),
    ],
    "verify": [
        ("--dihedral 15", "the following arguments are required: --weights"),
        ("--dihedral 15 --weights given.npz --set activation=tanh", "applies only to a network"),
        ("--dihedral 15 --weights folder.json", "the folder contains no critic"),
        (
            "--dihedral 15 --rate 50 --weights given.npz --dt 0.1 --discount 0.9",
            "--discount applies only to continuous time",
        ),
    ],
    "regenerate": [("--dynamics unsteady", "more than seven states")],
}


@pytest.mark.parametrize(
    ("command", "words", "named"),
    [(command, *case) for command, some in REFUSED.items() for case in some],
)
def test_bad_requests_are_refused_in_one_line(command, words, named):
    """Each bad request gives exit code 2 and one short, printable line that names the fault."""
    small("given.json")
    stored("given.npz", W=np.ones(21))
    Path("given.csv").write_text("name,dihedral,aileron_center\nlow,5,\nhigh,9,2\n", "utf-8")
    result = hfa(command, *words.split())
    assert_refused(result, BAD_INPUT, named)
    assert result.err.rstrip("\n").isprintable()
    assert len(result.err) < 800


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--frobnicate", "unknown option --frobnicate (see `hfa --help`)"),
        ("--dihedral 10 trim", "write hfa trim --dihedral"),
        ("trim --at 10 --dihedral 12", "--at and --dihedral are the same; give one of them"),
        (
            "trim --hold speed=70 --hold speed=71",
            "speed is given twice (70 and 71); give one value",
        ),
        ("frobnicate", "unknown command 'frobnicate' (see `hfa --help`)"),
        ("linearise", "unknown command 'linearise'; did you mean linearize?"),
        ("x" * 5000, "unknown command 'xxxx"),
        ("'trim --dihedral' 10", "'trim --dihedral' is one argument"),
        *((f"{command} --frobnicate", f"hfa {command} --help") for command in commands()),
    ],
)
def test_unknown_misplaced_and_repeated_words_are_refused(words, named):
    """An unknown, misplaced or repeated word is refused, and the message says what to type."""
    pytest.importorskip("hfa_flight")
    assert_refused(hfa(*shlex.split(words)), BAD_INPUT, named)
