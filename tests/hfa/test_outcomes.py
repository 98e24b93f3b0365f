"""What a command prints and writes is what the public functions return on the same request."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa as command
from game_files import AT_15, small, stored
from known_models import game_at
from project import ROOT

import hfa
from hfa_model import INPUTS

UAV = str(ROOT / "examples/uav.toml")
#: No trim exists at 3 m/s.
CONDITIONS = "name,speed,altitude\nlow,20 m/s,100 m\nhigh,25 m/s,500 m\nslow,3 m/s,100 m\n"

UNLIMITED = """
from hfa import Model, Signal
STATES, INPUTS = {"height": Signal("m")}, {"valve": Signal("m^3/s")}
MODEL = Model("tank", STATES, INPUTS, lambda x, u, p, w: ({"height": u.valve - x.height}, {}))
"""


def test_conditions_have_the_same_numbers_in_every_command():
    """Trims, linear models and sweep points of a file of conditions are those of `hfa.conditions`. A
    condition without a trim has a reason, and is counted.
    """
    Path("c.csv").write_text(CONDITIONS, "utf-8")
    words = ("--aircraft", UAV, "--conditions", "c.csv")
    book = hfa.conditions(hfa.load_model(UAV), "c.csv")
    swept = answer("sweep", *words)
    assert swept["names"] == list(book.names) == ["low", "high", "slow"]
    assert np.allclose(swept["A"][:2], book.A[:2], rtol=1e-9)
    sheets = json.loads(command("trim", *words, "--json").out)["sheets"]
    states = [list(each["operating_point"]["states"].values()) for each in sheets[:2]]
    assert states == [list(point.states) for point in book.points[:2]]
    assert "give a value between" in sheets[2]["reason"]
    assert command("linearize", *words, "-o", "models.json").code == 1
    models = json.loads(Path("models.json").read_text("utf-8"))["models"]
    assert [each["A"] for each in models[:2]] == book.A[:2].tolist()
    listed = command("trim", *words, "--document", "R-7", "-o", "book.html")
    assert listed.out.startswith("2 of 3 conditions are trimmed, 1 without a trim")
    alpha = f"{np.degrees(book.points[0].states.alpha):.6g}"
    assert ["low", "trimmed", alpha, "deg"] in [
        line.split()[:4] for line in listed.out.splitlines()
    ]
    page = Path("book.html").read_text("utf-8")
    assert [text for text in ("R-7", "c.csv (SHA-256", "slow") if text not in page] == []
    assert command("trim", *words, "-o", "book.csv").code == 1
    rows = Path("book.csv").read_text("utf-8").splitlines()
    assert [line.partition(",")[0] for line in rows[1:]] == ["low", "high", "slow"]
    single = answer("trim", *words, "--row", "high")
    assert (single["name"], single["operating_point"]) == ("high", sheets[1]["operating_point"])


def test_a_gain_table_has_the_solution_at_each_angle():
    """K, P and delta_min of several angles are those of each. Its table has the slowest pole."""
    table = answer("solve", "--dihedral", "5,10")
    assert table["dihedral_deg"] == [5.0, 10.0]
    printed = command("solve", "--dihedral", "5,10").out
    for number, angle in enumerate((5.0, 10.0)):
        solution = hfa.solve(game_at(angle))
        assert table["K"][number] == solution.K.tolist()
        assert table["P"][number] == solution.P.tolist()
        slowest = f"{solution.poles().real.max():.4g}"
        row = ["deg", f"{solution.delta_min:.6g}", slowest, f"{solution.disk_margin.disk:.4g}"]
        assert row in [line.split()[1:] for line in printed.splitlines()]


def test_a_solution_has_the_expansion_that_is_asked_for():
    """With --order 2, the report has P, and the weights of the 21 products of two of six states."""
    expanded = answer("solve", "--dihedral", "10", "--order", "2")
    assert expanded["P"] == hfa.solve(game_at(10.0)).P.tolist()
    assert len(expanded["W"]) == 21


def test_the_loop_at_the_further_delay_of_a_solution_is_at_its_limit():
    """x' = x + u at 20 Hz with 50 ms of delay. After the further delay printed, u acts for the last
    part of a step, and the largest eigenvalue of the loop has magnitude 1. The delay costs the
    ratio of both P of x.
    """
    file = small("plant.json", A=[[1.0]], B=[[1.0]], Q=[[1.0]], R=[[1.0]], E=None, delta=None)
    words = ("solve", "--model", file, "--rate", "20")
    solved = answer(*words, "--delay", "50ms")
    price = solved["P"][0][0] / answer(*words)["P"][0][0]
    printed = " ".join(command(*words, "--delay", "50ms").out.split())
    assert f"at most {price:.4g} times the optimum without" in printed
    assert f"of {1e3 * solved['further_delay']:.3g} ms makes the linear loop unstable" in printed
    ((k, k_before),) = solved["K"]
    whole, part = divmod(0.05 + solved["further_delay"], 0.05)
    count = int(whole) + 1  # commands under way
    late = np.exp(0.05 - part) - 1.0
    loop = np.eye(count + 1, k=-1)
    loop[0] = 0.0
    loop[0, [0, -2, -1]] = np.exp(0.05), late, np.exp(0.05) - 1.0 - late
    loop[1, :2] = -k, -k_before
    assert abs(np.linalg.eigvals(loop)).max() == pytest.approx(1.0, abs=1e-4)


def test_the_subject_of_a_verdict_is_stated():
    """`verify` notes what a critic's file gives: weights, inputs, sample time. It says which limits
    stand in no weights, and a gain that is nearly optimal how it passes.
    """
    plant = {"A": [[0.0, 1.0], [2.0, -0.3]], "B": [[0.0], [1.0]]}
    cost = {"Q": np.eye(2), "R": np.eye(1)}
    file = stored("plant.json", **plant)
    game = hfa.Game(**{key: np.array(value) for key, value in plant.items()}, **cost)
    exact = hfa.solve(game)
    words = ("verify", "--model", file, "--weights")
    own = answer(*words, stored("K.npz", K=exact.K, **cost))
    assert own["warnings"][1:] == ["used: Q, R of K.npz"]
    near = stored("near.npz", K=1.02 * exact.K, **cost)
    assert "--limit-cost 1 accepts it" in command(*words, near).out
    assert "--limit-cost 1 accepts it" not in command(*words, near, "--limit-cost", "1").out
    sampled = game.sampled(0.1, 0.9)
    H = stored("H.npz", H=hfa.solve(sampled).H, **cost, dt=0.1, discount=0.9)
    assert answer(*words, H)["ok"] is True
    assert answer(*words, H, "--dt", "0.1", "--discount", "0.8", code=1)["ok"] is False
    network = stored("network.npz", **{"0.weight": -exact.K})
    without = "Without sample time, delay and input limits"
    assert without in command(*words, network, "--Q", "1,1", "--R", "1").out
    assert without not in command(*words, near).out
    gain = stored("part.npz", K=np.zeros((1, 6)))
    one_input = ("--inputs", INPUTS[3], "--delta", "inf")
    assert "Q, R are the paper's" in command("verify", *AT_15, "--weights", gain, *one_input).out


def test_a_sweep_without_a_trim_draws_and_finds_nothing():
    """With no trim there is no picture; with one there is, and --dihedral is 0 if it is not given."""
    words = ("sweep", "--picture", "a.png", "--hold")
    none = command(*words, "speed=20,21")
    assert (none.code, Path("a.png").exists()) == (1, False)
    assert "nothing to draw" in none.err
    found = command(*words, "speed=20,68")
    assert (found.code, Path("a.png").exists()) == (0, True)
    assert "every point is at 0 deg" in found.err


def test_a_sheet_in_a_file_has_a_picture_where_a_variable_has_limits():
    """Beside the figures of the sheet, which --full prints; a model without limits has no picture."""
    short = command("trim", *AT_15, "-o", "a.html").out
    assert 2 * len(short) < len(command("trim", *AT_15, "--full").out)
    assert "data:image/" in Path("a.html").read_text("utf-8")
    Path("own.py").write_text(UNLIMITED, "utf-8")
    assert command("trim", "--aircraft", "own.py:MODEL", "-o", "b.html").code == 0
    assert "data:image/" not in Path("b.html").read_text("utf-8")


def test_learning_from_a_record_has_a_verdict_where_a_plant_is_given():
    """Without noise, the record x_next = 0.5 x + u determines P and K, with and without the plant. It
    has no bands, which rounding would leave; one with noise has them.
    """
    x, u, noise = np.random.default_rng(3).normal(size=(3, 40, 1))
    record = stored("record.npz", x=x, u=u, x_next=0.5 * x + u, dt=0.1)
    weights = ("--Q", "1", "--R", "1")
    plant = stored("plant.json", A=[[0.5]], B=[[1.0]], dt=0.1)
    exact = answer("solve", "--model", plant, *weights)
    compared = answer("learn", "--model", plant, "--data", record, *weights)
    assert (compared["converged"], "entries_in_bands" in compared) == (True, False)
    noisy = stored("noisy.npz", x=x, u=u, x_next=0.5 * x + u + 1e-6 * noise, dt=0.1)
    assert "entries_in_bands" in answer("learn", "--model", plant, "--data", noisy, *weights)
    alone = command("learn", "--data", record, *weights, "-o", "own.json")
    assert (alone.code, "not compared: no plant is given" in alone.out) == (0, True)
    for learned in (compared, json.loads(Path("own.json").read_text("utf-8"))):
        assert np.allclose(learned["K"], exact["K"], rtol=1e-9)
    law = answer("learn", "--model", small("small.json"), "--law", "policy-iteration")
    assert law["converged"] is True
