"""`hfa design`: a controller is made, written, printed again and checked; what is wrong is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from controllers import small_controller
from scipy.io import loadmat
from servo_cases import write_tuning

from controller import Actuator, load_controller, load_design, save_controller
from hfa_model import Aircraft
from verification.synthesis import gust_limits
from verification.synthesis.gust_limits import GustLimit, GustLimits


def test_a_design_becomes_a_file_that_prints_the_same_table() -> None:
    made = hfa("design", "--design", "simvfa-1", "--dihedral", "9:11:2", "-o", "servo.npz")
    assert made.code == 0
    again = hfa("design", "servo.npz")
    table = made.out.split("\n\n")[:-1]  # the last paragraph is the provenance
    assert again.out.split("\n\n")[:-1] == table
    assert "simvfa-1: state feedback, 2 states, 2 angles from 9 to 11 deg" in table[0]
    assert "smallest disk margin at sensors" in table[3]
    controller = load_controller("servo.npz")
    assert controller.about["provenance"]["command"].startswith("hfa design --design simvfa-1")
    data = answer("design", "servo.npz")
    np.testing.assert_array_equal(data["C"], controller.C)
    assert [row["dihedral"] for row in data["angles"]] == pytest.approx(controller.dihedrals)


def test_the_corners_decide_the_exit_code_and_matrices_go_to_other_tools(published_aircraft: Aircraft) -> None:
    found = hfa("design", "--design", "simvfa-1", "--dihedral", "11", "--corners", "-o", "servo.mat")
    assert found.code == 1
    assert "FAIL largest_abscissa: unstable at" in found.out
    assert loadmat("servo.mat")["D"].shape == (2, 11, 1) or loadmat("servo.mat")["D"].shape == (2, 11)


def test_a_search_writes_a_design_and_goes_on_where_it_ended() -> None:
    write_tuning(Path())
    words = ("design", "--tune", "tune.toml", "-o", "best.toml", "--picture", "seen.png")
    first = answer(*words, code=1)  # a corner stays unstable: what is written does not keep the constraints
    record = Path("best.toml.record").read_text(encoding="utf-8").splitlines()
    best = load_design("best.toml")
    assert best.input_weights["aileron_outer"] == first["variables"]["effort"]["best"]
    assert first["best"]["cost"] <= first["start"]["cost"]
    assert Path("seen.png").read_bytes().startswith(b"\x89PNG")
    Path("best.toml.record").write_text("\n".join(record[: len(record) // 2]) + "\n[[1.0, 2", encoding="utf-8")
    again = answer(*words, code=1)
    assert {key: again[key] for key in again if key != "provenance"} == {
        key: first[key] for key in first if key != "provenance"
    }
    assert Path("best.toml.record").read_text(encoding="utf-8").splitlines() == record
    digit = record[-1].replace("1", "2", 1)
    for damaged in (b"[1]\n", b"\xff\n", b"\n", digit.encode()):
        Path("best.toml.record").write_bytes("\n".join(record[:-1]).encode() + b"\n" + damaged)
        assert answer(*words, code=1)["best"] == first["best"]
        assert Path("best.toml.record").read_text(encoding="utf-8").splitlines() == record
    write_tuning(Path(), seed=2)
    assert_refused(hfa(*words), 2, "best.toml.record: this is the record of another search; remove it")


def test_the_designs_toward_another_are_flown_and_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    write_tuning(Path())
    monkeypatch.setattr("verification.synthesis.design_line.SHARES", (0.0, 1.0))
    found = answer("design", "--tune", "tune.toml", "--toward", "servo", "--picture", "line.png")
    assert found["toward"] == "servo"
    assert [point["share"] for point in found["points"]] == [0.0, 1.0]
    assert Path("line.png").read_bytes().startswith(b"\x89PNG")
    assert not Path("best.toml.record").exists()


def test_the_gusts_stand_beside_the_table(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    limit = GustLimit(0.2, 20.5, 160.0)
    monkeypatch.setattr(gust_limits, "gust_limits", lambda _, made, *__: GustLimits(made, Actuator(), (limit,)))
    save_controller("small.npz", small_controller(published_aircraft))
    assert "Gusts of 400 ft for controller small" in hfa("design", "small.npz", "--gusts").out
    found = answer("design", "small.npz", "--gusts")["gusts"]
    assert found == {"length": 400.0, "limits": [{"dihedral": 0.2, "held": 20.5, "best": 160.0}]}


@pytest.mark.parametrize(
    ("words", "code", "named"),
    [
        ("--tune tune.toml --gusts -o best.toml", 2, "--gusts belongs to --design; leave it out with --tune"),
        ("--design servo --toward servo", 2, "--toward belongs to --tune"),
        ("--tune tune.toml --toward none.toml", 2, "none.toml"),
        ("--tune tune.toml --toward servo -o best.toml", 2, "--output belongs to a search; leave it out with --toward"),
        ("", 2, "name what to do: one of --design NAME, --tune FILE, or the file of a controller"),
        ("small.npz --design simvfa-1", 2, "name what to do: one of --design NAME, --tune FILE, or the file"),
        ("small.npz --dihedral 3", 2, "--dihedral belongs to --design; leave it out with a file"),
        ("none.npz", 2, "none.npz: there is no such file"),
        ("plant.npz", 2, "plant.npz: this is no controller file"),
        ("small.npz --corners --dynamics newton", 2, "was designed for published dynamics, the aircraft has newton"),
        ("--design simvfa-1 -o servo.toml", 2, "a controller is written as .npz or .mat"),
        ("--tune tune.toml", 2, "--tune writes a design; name it with -o FILE.toml"),
        ("small.npz --picture seen.png", 2, "--picture belongs to --tune"),
        ("--tune tune.toml --corners -o best.toml", 2, "--corners belongs to --design; leave it out with --tune"),
        ("--tune none.toml -o best.toml", 2, "none.toml: there is no readable file of that name"),
        ("--design simvfa-1 --dihedral 0:5", 2, "--dihedral is LOW:HIGH"),
        ("--design simvfa-1 --feedback output", 2, "design simvfa-1 has no sensors"),
        ("--design simvfa-1 --feedback both", 2, "--feedback is 'both'; use one of state, output"),
    ],
)
def test_what_is_wrong_is_one_line(published_aircraft: Aircraft, words: str, code: int, named: str) -> None:
    save_controller("small.npz", small_controller(published_aircraft))
    np.savez("plant.npz", A=np.eye(2))
    write_tuning(Path())
    assert_refused(hfa("design", *words.split()), code, named)
    assert not Path("servo.npz").exists()
