"""`hfa verify` passes correct critics, and fails planted mistakes with their reason."""

import json
from pathlib import Path

import numpy as np
from cli import answer, hfa
from game_files import small, stored

from controller import load_game
from hfa import solve
from hfa.main import FAILED


def test_the_cost_limit_decides_the_exit_code():
    """A critic of 1.004 P, whose cost is less than 0.01 % above the optimum, fails by its error, and
    with --limit-cost 1e-9 (percent); it passes with --limit-cost 0.01, and with --limit-error 0.01.
    """
    plant = small("plant.json")
    file = stored("P.json", P=1.004 * solve(load_game(plant)).P)
    words = ("verify", "--model", plant, "--weights", file)
    graded = answer(*words, code=FAILED)["graded"]
    kept = answer(*words, "--limit-cost", "0.01")
    assert kept["ok"] is False
    assert kept["graded"]["ok"] is True
    assert kept["graded"]["limit_cost_percent"] == 0.01
    assert answer(*words, "--limit-cost", "1e-9", code=FAILED)["graded"]["ok"] is False
    assert answer(*words, "--limit-error", "0.01")["ok"] is True
    printed = hfa(*words, "--limit-cost", "0.01").out
    cost = f"{graded['cost_above_optimum_worst_percent']:.2g} % above the optimum"
    assert f"PASS on the linear game, balanced box: {cost}\n" in printed
    assert "\ndecided by the cost limit 0.01 %\n" in printed


def test_several_critics_give_a_table_and_a_curve():
    """Several critics and a folder of checkpoints give one table and a learning curve."""
    plant = small("plant.json")
    exact = solve(load_game(plant))
    Path("runs").mkdir()
    for step, share in ((2, 3.0), (10, 1.5)):
        np.savez(f"runs/step_{step}.npz", K=share * exact.K)
    names = ["runs/step_2.npz", "runs/step_10.npz"]
    names += [stored("right.npz", P=exact.P), stored("P.npz", P=2 * exact.P)]
    words = ("verify", "--model", plant, "--weights", "runs", *names[2:])
    result = hfa(*words, "-o", "a.json", "--picture", "curve.png")
    assert result.code == FAILED
    data = json.loads(Path("a.json").read_text(encoding="utf-8"))["critics"]
    assert list(data) == names
    assert [each["ok"] for each in data.values()] == [False, False, True, False]
    assert data[names[0]]["K_rel_error"] > data[names[1]]["K_rel_error"]
    assert result.out.startswith("FAIL: 1 of 4 critics pass")
    assert "\nP.npz: the value is twice the exact one" in result.out
    assert Path("curve.png").stat().st_size > 10_000  # bytes; an empty picture has fewer
