"""Critics judged through the command line: right ones pass, planted mistakes are refused with their reason."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import Terminal, hfa
from game_answers import AT_15, LABELS, QUICK, answer, checks_of
from game_files import small, stored
from scipy.io import loadmat

from controller.game.zero_sum import Game
from controller.study.published_study import STUDY
from hfa_cli.main import DONE, FAILED, INTERRUPTED
from verification.riccati.gare import solve_game


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


# Verify.


def test_verify_keeps_the_contract() -> None:
    data = answer("verify", *AT_15)
    assert data["ok"] is True
    assert max(data["P_rel_error"], data["K_rel_error"]) <= 1e-11
    assert all(set(check) >= {"name", "value", "limit", "ok"} and check["ok"] for check in data["checks"])
    assert set(checks_of(data)) >= {"data_rank", "settling_time", "l2_gain", "saddle_control_loses"}
    assert set(data) >= {"schema", "diagnosis", "P", "K", "P_exact", "K_exact", "disk_margin"} | LABELS
    assert data["diagnosis"] == ""


def test_verify_prints_a_table_of_checks() -> None:
    said = hfa("verify", "--model", small("plant.json"), *QUICK).out
    assert said.startswith("Critic on plant.json, against the exact game solution: agrees\n")
    assert "\ncheck " in said
    assert "FAIL" not in said
    assert said.count(" pass\n") == 16
    assert "\nP(x1, x2) " in said


def test_verify_writes_files() -> None:
    plant = small("plant.json")
    for suffix in ("json", "npz", "mat", "csv"):
        assert hfa("verify", "--model", plant, *QUICK, "-o", f"check.{suffix}").code == DONE
    data = json.loads(Path("check.json").read_text(encoding="utf-8"))
    with np.load("check.npz") as archive:
        np.testing.assert_array_equal(archive["P_exact"], data["P_exact"])
    np.testing.assert_array_equal(loadmat("check.mat", simplify_cells=True)["P"], data["P"])
    with Path("check.csv").open(encoding="utf-8", newline="") as stream:
        assert next(stream) == f"# schema: {data['schema']}\n"
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4 + 2
    for kind in ("learned", "exact"):
        found = {(row["matrix"], row["row"], row["column"]): float(row[kind]) for row in rows}
        suffix = "" if kind == "learned" else "_exact"
        assert found["P", "x1", "x2"] == data[f"P{suffix}"][0][1]
        assert found["K", "u1", "x2"] == data[f"K{suffix}"][0][1]


@pytest.mark.parametrize(("kind", "suffix"), [("W", "json"), ("P", "npz"), ("K", "mat"), ("W", "mat")])
def test_verify_passes_an_exact_critic_from_elsewhere(game: Game, kind: str, suffix: str) -> None:
    exact = solve_game(game)
    row, column = np.triu_indices(6)
    weights = np.where(row == column, 1.0, 2.0) * exact.P[row, column]
    file = stored(f"critic.{suffix}", **{kind: {"W": weights, "P": exact.P, "K": exact.K}[kind]})
    data = answer("verify", *AT_15, "--weights", file)
    assert data["ok"] is True
    assert data["K_rel_error"] <= 1e-14
    assert (data["P_rel_error"] is None) == (kind == "K")
    assert not {"data_rank", "settling_time"} & set(checks_of(data))


@pytest.mark.parametrize(
    ("name", "beyond", "bent"), [("quadratic+linear", 2, -1), ("quadratic+quartic", 2, -1), ("paper", 4, -4)]
)
def test_verify_takes_weights_of_every_basis(name: str, beyond: int, bent: int) -> None:
    words = AT_15 if name == "paper" else ("--model", small("plant.json"))
    P = np.array(answer("solve", *words)["P"])
    row, column = np.triu_indices(len(P))
    weights = np.concatenate([np.where(row == column, 1.0, 2.0) * P[row, column], np.zeros(beyond)])
    assert answer("verify", *words, "--weights", stored("W.npz", W=weights), "--basis", name)["ok"] is True
    weights[bent] = 1e-3 * abs(weights[0])  # leaves P and K alone and bends the policy
    wrong = answer("verify", *words, "--weights", stored("W.npz", W=weights), "--basis", name, code=FAILED)
    assert {row["name"] for row in wrong["checks"] if not row["ok"]} == {"policy_rel_error"}


def test_the_limit_of_errors_is_the_users(game: Game) -> None:
    file = stored("P.json", P=(1.0 + 1e-5) * solve_game(game).P)
    assert answer("verify", *AT_15, "--weights", file, code=FAILED)["P_rel_error"] == pytest.approx(1e-5, rel=1e-6)
    assert answer("verify", *AT_15, "--weights", file, "--limit-error", "2e-5")["ok"] is True


# Planted mistakes.


def lqr(game: Game) -> np.ndarray:
    return solve_game(game.with_delta(math.inf)).P


def other_root(game: Game) -> np.ndarray:
    """The root of the Riccati equation with one real eigenvalue of the closed loop reflected."""
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    values, vectors = np.linalg.eig(H)
    stable = [i for i in range(len(values)) if values[i].real < 0]
    real = min((i for i in stable if abs(values[i].imag) < 1e-9), key=lambda i: values[i].real)
    chosen = [int(np.argmin(np.abs(values + values[real]))) if i == real else i for i in stable]
    P = np.real(vectors[6:, chosen] @ np.linalg.inv(vectors[:6, chosen]))
    return (P + P.T) / 2


def recorded_policy(game: Game) -> np.ndarray:
    """The value of the policies of another P, as a stack with frozen policies teaches it."""
    from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

    P0 = solve_continuous_are(game.A, game.B, 1000.0 * np.eye(6), game.R)
    return solve_continuous_lyapunov((game.A - game.S @ P0).T, -(game.Q + P0 @ game.S @ P0))


def swapped(game: Game) -> np.ndarray:
    row, column = np.triu_indices(6)
    weights = np.where(row == column, 1.0, 2.0) * solve_game(game).P[row, column]
    weights[[3, 7]] = weights[[7, 3]]
    return weights


MISTAKES = {
    "LQR value": ("P", lqr, "this is the LQR solution (delta = inf), not the game's at delta = 200"),
    "LQR gain": ("K", lambda game: game.gain(lqr(game)), "this is the LQR gain (delta = inf)"),
    "wrong sign": ("K", lambda game: -solve_game(game).K, "the gain has the wrong sign: the policy is u = -K z"),
    "another root": ("P", other_root, "this is another root of the Riccati equation"),
    "recorded policy": ("P", recorded_policy, "this may be the value of a recorded policy instead of its own"),
    "swapped weights": ("W", swapped, "weights 4 and 8 stand in each other's place"),
    "upper triangle": ("P", lambda game: np.triu(solve_game(game).P), "P is not symmetric"),
    "no gain": ("K", lambda game: np.zeros((5, 6)), "K is off by 1"),
    "5 degrees": ("K", lambda game: np.array(answer("solve", "--dihedral", "5")["K"]), "K is off by"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_planted_mistake_is_refused_with_its_reason(game: Game, mistake: str) -> None:
    kind, plant, reason = MISTAKES[mistake]
    file = stored("critic.npz", **{kind: plant(game)})
    data = answer("verify", *AT_15, "--weights", file, code=FAILED)
    assert data["ok"] is False
    failed = [check for check in data["checks"] if not check["ok"]]
    assert reason in failed[0]["reason"]
    assert all(check["reason"] for check in failed)


def test_a_refusal_in_words_begins_with_the_reason(game: Game) -> None:
    said = hfa("verify", *AT_15, "--weights", stored("critic.npz", K=-solve_game(game).K))
    assert (said.code, said.err) == (FAILED, "")
    lines = said.out.splitlines()
    assert lines[0].endswith("against the exact game solution: REFUSED")
    assert lines[2] == "Reason: the gain has the wrong sign: the policy is u = -K z"
    assert sum(line.endswith(" FAIL") for line in lines) == sum(line.startswith("FAIL ") for line in lines) >= 3


def test_a_law_that_runs_but_fails_is_refused() -> None:
    words = ("--law", "published", "--set", "integrator=proximal", "--set", "step=0.05", "--set", "basis=quadratic")
    data = answer("verify", *AT_15, *words, code=FAILED)
    assert "starts from a policy that does not stabilize" in data["diagnosis"]
    failed = {check["name"] for check in data["checks"] if not check["ok"]}
    assert {"P_rel_error", "K_rel_error", "control_loop_abscissa", "settling_time"} <= failed


# Pictures.


@pytest.mark.parametrize("suffix", ["png", pytest.param("svg", marks=pytest.mark.slow)])
def test_verify_draws_a_run(suffix: str) -> None:
    words = ("verify", "--model", small("plant.json"), *QUICK, "--picture", f"check.{suffix}")
    assert hfa(*words).code == DONE
    begins = {"png": b"\x89PNG\r\n", "svg": b"<?xml"}[suffix]
    first = Path(f"check.{suffix}").read_bytes()
    assert first.startswith(begins)
    assert hfa(*words).code == DONE
    assert Path(f"check.{suffix}").read_bytes() == first


@pytest.mark.parametrize("kind", ["P", "K"])
def test_verify_draws_what_it_refuses(kind: str) -> None:
    critic = stored("critic.npz", **{kind: np.zeros((2, 2) if kind == "P" else (1, 2))})
    words = ("verify", "--model", small("plant.json"), "--weights", critic, "--picture")
    assert hfa(*words, "check.svg").code == FAILED
    picture = Path("check.svg").read_text(encoding="utf-8")
    assert f"<!-- {kind} learned -->" in picture
    assert f"<!-- {'K' if kind == 'P' else 'P'} learned -->" not in picture


# The study of the paper's law.


def test_the_study_keeps_finished_rows_and_takes_them_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(_: object, fraction: float, row: str) -> None:
        if row.startswith("learning alone"):
            raise KeyboardInterrupt

    words = ("study", "--only", "learning alone, frozen", "--only", "theorem gains, explicit", "--folder", "rows")
    names = ["theorem gains, explicit", "learning alone, frozen, implicit"]
    with monkeypatch.context() as patched:
        patched.setattr("hfa_cli.output.Progress.say", stop)
        assert hfa(*words, err=Terminal()).code == INTERRUPTED
    assert [path.name for path in Path("rows").iterdir()] == ["theorem-gains-explicit.json"]
    kept = json.loads(
        Path("rows", "theorem-gains-explicit.json").read_text(encoding="utf-8"), parse_constant=pytest.fail
    )
    whole = hfa(*words, "--resume", "-o", "study.json", err=Terminal())
    assert whole.code == DONE
    assert "study: 100 %" in whole.err
    assert names[0] not in whole.err
    data = json.loads(Path("study.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert data["rows"][0] == kept["rows"][0]
    counts = [(row["name"], row["count"], row["overflow"], row["certified"]) for row in data["rows"]]
    assert counts == [(names[0], 48, 48, 0), (names[1], 4, 0, 0)]
    for name in names:
        assert f"\n{name}: {STUDY[name].cause}" in whole.out

    def refuse(*_: object) -> None:
        raise AssertionError("a finished row is run again")

    monkeypatch.setattr("controller.study.published_study._run", refuse)
    for suffix in ("json", "npz", "mat", "csv"):
        again = hfa(*words, "--resume", "-o", f"again.{suffix}")
        assert (again.code, again.out, again.err) == (DONE, whole.out, "")
    assert Path("again.json").read_bytes() == Path("study.json").read_bytes()
    assert len(Path("again.csv").read_text(encoding="utf-8").splitlines()) == 2 + 48 + 4
    with pytest.raises(AssertionError, match="is run again"):
        hfa(*words)


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text.replace('"eta": 0.8', '"eta": 0.7') + "{",
        lambda text: text.replace('"identity": "', '"identity": "0'),
        lambda text: text.replace('"toolchain": "', '"toolchain": "0'),
        lambda text: text.replace("hfa.published-study/1", "hfa.published-study/0"),
        lambda text: "[1]",
    ],
)
def test_a_row_that_is_not_todays_is_run_again(damage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("study", "--only", "theorem gains, explicit", "--folder", "rows", "--resume")
    whole, file = hfa(*words), Path("rows", "theorem-gains-explicit.json")
    assert whole.code == DONE
    text = file.read_text(encoding="utf-8")
    file.write_text(damage(text), encoding="utf-8")
    assert file.read_text(encoding="utf-8") != text
    assert hfa(*words) == whole
    assert file.read_text(encoding="utf-8") == text
    with monkeypatch.context() as patched:
        patched.setattr("hfa_model.support.finished.toolchain_version", lambda: "0.0.9")
        assert hfa(*words) == whole
    assert '"toolchain": "0.0.9"' in file.read_text(encoding="utf-8")
