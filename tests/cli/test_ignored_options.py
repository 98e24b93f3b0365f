"""No option is passed over in silence: what would do nothing, or be overridden, is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa_support.jobs.store import open_store

FLY = "fly --dihedral 15 --law exact --duration 0.1"
CARLO = "monte-carlo --dihedral 15 --law exact --duration 0.1 --members 2"
STORE = "-o a.zarr"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        # The same thing twice.
        ("trim --dihedral 15 --dihedral 5", "--dihedral is given twice, as '15' and as '5'; give it once"),
        ("trim --dihedral 15 --dynamics published --dynamics newton", "--dynamics is given twice"),
        ("trim --dihedral 15 --hold alpha=1 --hold alpha=2", "alpha is given twice, as '1' and as '2'"),
        ("trim --dihedral 15 --limit throttle=0:9 --limit throttle=0:99", "throttle is given twice"),
        ("learn --dihedral 15 --set eta=1 --set eta=2", "eta is given twice"),
        (f"{FLY} --initial speed=1 --initial speed=2", "speed is given twice"),
        (f"sweep --dihedral 0:10:5 --vary dihedral=0:20:10 {STORE}", "dihedral is given twice, by --dihedral and by"),
        (f"sweep --vary panel_mass=1,2 --vary panel_mass=3 {STORE}", "panel_mass is given twice"),
        # What belongs to something that was not asked for.
        (f"sweep --dihedral 0:10:5 --seed 3 {STORE}", "--seed belongs to --samples"),
        ("sweep --dihedral 0:10:5 --seed 0", "--seed needs a store"),
        (f"sweep --dihedral 0:10:5 --workers 2 --scheduler tcp://a:1 {STORE}", "--workers are processes here"),
        (f"sweep --dihedral 5 --speed 60 --samples 3 {STORE}", "--samples has nothing to draw"),
        (f"sweep --dihedral 5:1 --samples 3 {STORE}", "dihedral is '5:1'"),
        (f"{CARLO} --workers 2 --scheduler tcp://a:1", "--workers are processes here"),
        ("monte-carlo --dihedral 15 --gain k.npz --delta 300", "--delta belongs to the game of a law"),
        ("monte-carlo --dihedral 15 --gain k.npz --Q 1,1,1,1,1,1", "--Q belongs to the game of a law"),
        ("verify --dihedral 15 --weights k.npz --basis=", "unknown basis ''"),
        (f"sweep --dihedral 0:5:1 --picture a.png {STORE}", "--picture does not go with a store"),
        ("sweep --dihedral 0:5:1 --samples 5", "--samples needs a store"),
        (f"sweep --dihedral 0:10:5 --speed 60:70 --samples 3 {STORE}", "dihedral is a grid; with --samples give"),
        (f"{FLY} --seed 3", "here nothing is random"),
        (f"{FLY} --gust 50:5:30", "--gust begins at 30 s"),
        (f"{FLY} --reference speed=1:2:0", "--reference speed frequency is 0 rad/s"),
        (f"{FLY} --actuators 0.05:-3", "--actuators rate is -3 deg/s"),
    ],
)
def test_what_would_be_passed_over_is_refused(folder: Path, words: str, named: str) -> None:
    np.savez(folder / "k.npz", K=np.zeros((5, 6)))
    assert_refused(hfa(*words.split()), 2, named)
    assert [path.name for path in folder.iterdir()] == ["k.npz"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("trim --dihedral 15 --start", "cannot be read"),
        ("solve --dihedral 15 --Q", "Q: entry 1 is ''"),
        (f"{FLY} --Q", "Q: entry 1 is ''"),
        (f"{FLY} --R", "R: entry 1 is ''"),
        ("map --dihedral 15 --speeds", "--speeds is ''"),
        ("fly --dihedral 15 --to", "--to has become a command"),
        ("trim --dihedral 15 --speed", "--speed is ''"),
        ("learn --dihedral 15 --law", "unknown law ''"),
        ("sweep --dihedral 0:5:1 --samples", "--samples is ''"),
        ("sweep --dihedral 0:5:1 -o a.zarr --picture", "--picture '': unknown suffix ''"),
        ("identify --write", "--write '': there is no such folder"),
        ("report --folder", "--folder '': cannot make the folder"),
    ],
)
def test_an_empty_word_is_not_passed_over(folder: Path, words: str, named: str) -> None:
    assert_refused(hfa(*words.split(), ""), 2, named)
    assert list(folder.iterdir()) == []


def test_a_number_beside_random_samples_is_a_constant() -> None:
    result = hfa("sweep", "--dihedral", "15", "--speed", "60:70", "--samples", "10", "-o", "a.zarr", "--json")
    assert (result.code, json.loads(result.out)["points"]) == (0, 10)
    dihedral, speed = open_store(Path("a.zarr")).read("values").T
    np.testing.assert_array_equal(dihedral, np.full(10, np.radians(15.0)))
    assert len(set(np.floor(speed - 60.0))) == 10


def test_a_flight_takes_no_disturbance_as_the_solution_does() -> None:
    words = ("--dihedral", "15", "--delta", "inf", "--json")
    K = json.loads(hfa("solve", *words).out)["K"]
    flown = hfa("fly", *words, "--law", "exact", "--duration", "0.1")
    assert flown.code == 0
    np.testing.assert_allclose(json.loads(flown.out)["policy"]["K"], K, rtol=1e-9)


def test_too_little_memory_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trim.sweeps.points._newton", lambda *_, **__: np.empty(10**15))
    assert_refused(hfa("sweep", "--dihedral", "0:5:1"), 2, "not enough memory")
