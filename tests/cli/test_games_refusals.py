"""What `hfa solve`, `learn`, `verify` refuse: one line that names thing and remedy, nothing written."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import SMALL, small, stored

from hfa_cli.main import BAD_INPUT, DONE, FAILED
from hfa_model import LINEAR_STATES, default_parameters, save_parameters

AT_15 = ("--dihedral", "15")
GAME_COMMANDS = ("solve", "learn", "verify")


@pytest.fixture(autouse=True)
def _nothing_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Files `given...` are a test's own; no other may be there afterwards."""
    yield
    assert [path.name for path in tmp_path.iterdir() if not path.name.startswith("given")] == []


def outputs(command: str) -> tuple[str, ...]:
    """Everything that the command could write."""
    written = ("-o", "result.json")
    return (*written, "--picture", "picture.png") if command == "verify" else written


def assert_command_refuses(command: str, words: tuple[str, ...], code: int, *named: str) -> None:
    assert_refused(hfa(command, *words, *outputs(command)), code, *named)


@pytest.mark.parametrize("command", GAME_COMMANDS)
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("", "either --dihedral DEG or --model FILE"),
        ("--dihedral 15 --model given.json", "either --dihedral DEG or --model FILE"),
        ("--dihedral 15 --delta 0", "delta is 0.0; it must be a positive number"),
        ("--dihedral 15 --delta -1", "delta is -1.0; it must be a positive number"),
        ("--dihedral 15 --delta nan", "delta is nan; give a finite number"),
        ("--dihedral 15 --delta big", "delta is 'big'; give a number"),
        ("--dihedral 15 --delta 1e-60", "1/delta^2 must not exceed 1e+100"),
        ("--dihedral 15 --R 100,400,400,400,0", "R is not positive definite (smallest eigenvalue 0); make every"),
        ("--dihedral 15 --R 100,400,400,400", "R is 4 x 4; with this A and B it must be 5 x 5"),
        ("--dihedral 15 --Q 1,1,1,1,1,-1", "Q is not positive semidefinite (smallest eigenvalue -1); make no"),
        ("--dihedral 15 --Q 1,1,1,1,1,nan", "Q[5][5] is nan; every entry must be finite"),
        ("--dihedral 15 --Q 1,two,3,4,5,6", "Q: entry 2 is 'two'; give the diagonal as numbers"),
        ("--dihedral 15 --Q=", "Q: entry 1 is ''; give the diagonal as numbers"),
        ("--dihedral 15 --dynamics aristotle", "'aristotle'"),
        ("--model given.json --speed 70", "--speed belongs to the aircraft; leave it out with --model"),
        ("--model given.json --alpha 2", "--alpha belongs to the aircraft; leave it out with --model"),
        ("--model given.json --limit throttle=0:1", "--limit belongs to the aircraft"),
        ("--model given.json --parameters given.toml", "--parameters belongs to the aircraft"),
        ("--model given.json --dynamics newton", "--dynamics belongs to the aircraft"),
        ("--model nowhere.json", "nowhere.json: there is no such file"),
        ("--model given.xlsx", "the suffix '.xlsx' is not known; use .json, .npz, .mat"),
    ],
)
def test_bad_games(command: str, words: str, named: str) -> None:
    small("given.json")
    save_parameters(default_parameters(), Path("given.toml"), "")
    assert_command_refuses(command, tuple(words.split()), BAD_INPUT, named)


PLANTS: dict[str, tuple[dict[str, Any], int, str]] = {
    "no A": ({"A": None}, BAD_INPUT, "there is no A; a model file holds A and B (found: B, E, Q, R, delta)"),
    "no B": ({"B": None}, BAD_INPUT, "there is no B; a model file holds A and B"),
    "A not square": ({"A": [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]}, BAD_INPUT, "A is 2 x 3; it must be square"),
    "nan": ({"A": [[0.0, math.nan], [1.0, 1.0]]}, BAD_INPUT, "A[0][1] is nan; every entry must be finite"),
    "inf": ({"B": [[0.0], [math.inf]]}, BAD_INPUT, "B[1][0] is inf; every entry must be finite"),
    "B of another size": ({"B": [[1.0], [1.0], [1.0]]}, BAD_INPUT, "B is 3 x 1; with this A and B it must be 2 x 1"),
    "E of another size": ({"E": [[1.0]]}, BAD_INPUT, "E is 1 x 1; with this A and B it must be 2 x 1"),
    "R not positive definite": ({"R": [[-1.0]]}, BAD_INPUT, "R is not positive definite"),
    "R not symmetric": (
        {"B": [[0.0, 1.0], [1.0, 0.0]], "R": [[1.0, 0.5], [0.0, 1.0]]},
        BAD_INPUT,
        "R is not symmetric; give a symmetric matrix",
    ),
    "Q indefinite": ({"Q": [[1.0, 2.0], [2.0, 1.0]]}, BAD_INPUT, "Q is not positive semidefinite"),
    "no Q": ({"Q": None}, BAD_INPUT, "the model has 2 states and the Q of the paper is for 6; give Q in the file"),
    "no R": ({"R": None}, BAD_INPUT, "the model has 1 inputs and the R of the paper is for 5; give R in the file"),
    "delta negative": ({"delta": -1.0}, BAD_INPUT, "delta is -1.0; it must be a positive number"),
    "not stabilizable": ({"A": [[1.0, 0.0], [0.0, -1.0]]}, FAILED, "stabilizable"),
    "delta too small": ({"delta": 0.1}, FAILED, "delta = 0.1"),
}


@pytest.mark.parametrize("command", GAME_COMMANDS)
@pytest.mark.parametrize("plant", PLANTS)
def test_bad_plants(command: str, plant: str) -> None:
    changes, code, named = PLANTS[plant]
    assert_command_refuses(command, ("--model", small("given.json", **changes)), code, named)


@pytest.mark.parametrize("suffix", ["npz", "mat"])
@pytest.mark.parametrize("plant", ["no A", "A not square", "nan", "R not positive definite", "not stabilizable"])
def test_bad_plants_in_other_formats(plant: str, suffix: str) -> None:
    changes, code, named = PLANTS[plant]
    named = named.partition(" (found")[0]
    assert_command_refuses("solve", ("--model", small(f"given.{suffix}", **changes)), code, named)


def test_what_has_no_solution_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    unreachable = small("given.json", A=[[1.0, 0.0], [0.0, -1.0]])
    line = hfa("solve", "--model", unreachable).err
    assert "no input reaches the mode with eigenvalue +1; change B or leave that mode out of A" in line
    free = small("given.json", A=[[0.0, 1.0], [-1.0, 0.0]], Q=[[0.0, 0.0], [0.0, 0.0]])
    line = hfa("solve", "--model", free).err
    assert "the undamped mode with eigenvalue +0+1j costs nothing; give Q weight on it" in line
    line = hfa("solve", *AT_15, "--delta", "113.549").err
    assert "hfa: not certified: " in line
    assert re.search(r"delta = 113.549 is only 0.000\d+ % above delta_min = 113.5486; ask for a larger delta$", line)
    monkeypatch.setattr("controller.analysis.cost.SLOPE_TOLERANCE", 0.0)
    line = hfa("solve", "--model", small("given.json")).err
    assert line.startswith("hfa: certified, but not confirmed in flight: saddle_control_slope_error: the cost changes")
    assert "delta = 3 is well above delta_min = 1.312475; check the scaling of A, B, Q and R" in line


@pytest.mark.parametrize("command", ["learn", "verify"])
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--law sarsa", "unknown law 'sarsa'; choose from certified, irl"),
        ("--set predefined_time=0", "predefined_time is 0.0; it must be a positive number"),
        ("--set predefined_time=-1", "predefined_time is -1.0; it must be a positive number"),
        ("--set predefined_time=nan", "predefined_time is nan; give a finite number"),
        ("--set samples=20", "20 samples cannot determine 21 weights; record at least 21"),
        ("--set samples=24 --set basis=paper", "24 samples cannot determine 25 weights; record at least 25"),
        ("--set pool_samples=15 --set samples=15", "15 samples cannot determine 21 weights"),
        ("--law irl --set intervals=20", "20 intervals cannot determine 21 weights; record more of them"),
        ("--set samples=21.5", "samples is 21.5; give a whole number"),
        ("--set basis=cubic", "unknown basis 'cubic'; choose from quadratic, quadratic+linear"),
        ("--set tick=20", "tick is 20.0 s; it must not exceed the predefined time 10.0 s"),
        ("--set eta=1", "eta is 1.0; it must lie between 0 and 1, both excluded"),
        ("--set initial_weights=1,2,3", "initial weights are (3,); basis 'quadratic' has 21 weights"),
        ("--set initial_weights=1e300", "it must not exceed 1e+60"),
        ("--set speed=1", "law 'certified' has no setting 'speed'; choose from predefined_time"),
        ("--set tick", "'tick' is not NAME=VALUE"),
        ("--law irl --set disturbance_measured=maybe", "disturbance_measured is 'maybe'; give yes or no"),
        ("--Q 0,0,0,0,0,0", "Q is zero: every law measures its residual against z'Qz; give some state a cost"),
        ("--seed -1", "--seed is -1; give a whole number from 0"),
    ],
)
def test_bad_runs(command: str, words: str, named: str) -> None:
    stored("given.npz", A=np.eye(2))
    small("given.json")
    assert_command_refuses(command, (*AT_15, *words.split()), BAD_INPUT, named)


@pytest.mark.parametrize("command", ["learn", "verify"])
def test_a_basis_that_does_not_fit_the_plant(command: str) -> None:
    words = ("--model", small("given.json"), "--set", "basis=paper")
    assert_command_refuses(command, words, BAD_INPUT, "basis 'paper' is for 6 states, not 2; choose 'quadratic'")


BACKWARDS = LINEAR_STATES[::-1]


@pytest.mark.parametrize(
    ("critic", "words", "named"),
    [
        ({"W": np.ones(20)}, "", "there are 20 weights; basis 'quadratic' on 6 states has 21: no basis has as many"),
        ({"W": np.ones(27)}, "", "has 21: name the basis of the weights, 'quadratic+linear' or 'quadratic+quartic'"),
        ({"K": np.ones((5, 6)) * 1j}, "", "K is complex; give its real part"),
        ({"K": np.ones((5, 6)), "states": BACKWARDS}, "", f"its states are in the order {', '.join(BACKWARDS)}"),
        ({"W": np.ones(21)}, "--basis paper", "there are 21 weights; basis 'paper' on 6 states has 25"),
        ({"W": np.ones(21)}, "--basis cubic", "unknown basis 'cubic'; choose from quadratic"),
        ({"W": np.ones((3, 7))}, "", "W has shape (3, 7); weights are one row or one column"),
        ({"W": np.full(21, np.nan)}, "", "W is empty or has entries that are not finite"),
        ({"W": np.full(21, 1e60)}, "", "W has an entry of 1e+60; entries must not exceed 1e+50"),
        ({"P": np.ones((5, 5))}, "", "P is 5 x 5; on a plant with 6 states it must be 6 x 6"),
        ({"P": np.ones((6, 3))}, "", "P is 6 x 3; on a plant with 6 states it must be 6 x 6"),
        ({"K": np.ones((6, 5))}, "", "K is 6 x 5; on a plant with 6 states and 5 inputs it must be 5 x 6"),
        ({"K": np.ones(30)}, "", "K has 1 dimension(s); it must be a matrix"),
        ({"gain": np.ones((5, 6))}, "", "there is no W, P or K; a weights file holds one of them (found: gain)"),
    ],
)
def test_bad_critics(critic: dict[str, Any], words: str, named: str) -> None:
    file = stored("given.npz", **critic)
    result = hfa("verify", *AT_15, "--weights", file, *words.split(), "-o", "result.json", "--picture", "picture.png")
    assert result.err.count("given.npz") <= 1
    assert_refused(result, BAD_INPUT, named, *(() if "basis=" in words or "cubic" in words else ("given.npz",)))


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--law certified", "--law belongs to a law; leave it out with --weights"),
        ("--seed 3", "--seed belongs to a law; leave it out with --weights"),
        ("--set tick=1", "--set belongs to a law; leave it out with --weights"),
        ("--limit-error 0", "--limit-error is 0; it must be positive"),
        ("--limit-error x", "--limit-error is 'x'; give a number"),
        ("--delta 100", "delta_min = 113.5486; ask for a larger delta"),
    ],
)
def test_bad_requests_with_weights(words: str, named: str) -> None:
    file = stored("given.npz", W=np.ones(21))
    code = FAILED if "--delta" in words else BAD_INPUT
    result = hfa("verify", *AT_15, "--weights", file, *words.split(), "-o", "result.json", "--picture", "picture.png")
    assert_refused(result, code, named)


def test_a_basis_belongs_to_weights() -> None:
    assert_command_refuses("verify", (*AT_15, "--basis", "quadratic"), BAD_INPUT, "use --set basis=")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("learn --dihedral 15 -o run.txt", "unknown suffix '.txt'; use one of .json, .npz, .mat, .csv"),
        ("verify --dihedral 15 --picture check.jpg", "unknown suffix '.jpg'; use one of .png, .svg, .pdf"),
        ("verify --dihedral 15 --picture missing/check.png", "the folder missing does not exist"),
        ("solve --dihedral 15 -o missing/solution.json", "the folder missing does not exist"),
    ],
)
def test_bad_files(words: str, named: str) -> None:
    small("given.json")
    assert_refused(hfa(*words.split()), BAD_INPUT, named)


def test_the_small_plant_itself_is_not_refused() -> None:
    assert SMALL["delta"] == 3.0
    assert hfa("solve", "--model", small("given.json")).code == DONE
