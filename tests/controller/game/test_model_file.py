"""A user's plant and critic from files: entries read, filled in and refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from game_files import small, stored
from scipy.io import savemat
from scipy.sparse import csc_matrix

from controller import Game, load_critic, load_game
from controller.game.model_file import stored_game
from hfa_cli.options.games import parse_diagonal
from hfa_model import LINEAR_STATES, published_models
from hfa_support import BadInputError

A2 = [[0.0, 1.0], [-2.0, -3.0]]
B2 = [[0.0], [1.0]]
Q2, R1 = [[2.0, 0.0], [0.0, 1.0]], [[4.0]]


def _json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def model() -> dict[str, np.ndarray]:
    return {"A": published_models()[0].A, "B": published_models()[0].B}


def _same(one: Game, other: Game) -> bool:
    matrices = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in "ABEQR")
    return matrices and one.delta == other.delta


def test_where_a_plant_comes_from_is_read(tmp_path: Path, model: dict[str, np.ndarray]) -> None:
    block = {"version": "1.2", "parameters": "ab12"}
    np.savez(tmp_path / "a.npz", **model, **{f"provenance.{name}": word for name, word in block.items()})  # type: ignore[arg-type]
    savemat(tmp_path / "a.mat", model | {"provenance": block})
    _json(tmp_path / "a.json", {name: matrix.tolist() for name, matrix in model.items()} | {"provenance": block})
    for suffix in ("npz", "mat", "json"):
        assert stored_game(tmp_path / f"a.{suffix}").provenance == block


def test_every_format_gives_the_same_game(tmp_path: Path, model: dict[str, np.ndarray]) -> None:
    extra = {"E": np.eye(6)[:, :2], "Q": 2.0 * np.eye(6), "R": 3.0 * np.eye(5), "delta": 321.0}
    full = model | extra
    np.savez(tmp_path / "plant.npz", **full)
    savemat(tmp_path / "plant.mat", full)
    savemat(tmp_path / "sparse.MAT", full | {"A": csc_matrix(full["A"])})
    _json(tmp_path / "plant.json", {key: np.asarray(value).tolist() for key, value in full.items()})
    expected = Game(**full)
    for name in ("plant.npz", "plant.mat", "sparse.MAT", "plant.json"):
        assert _same(load_game(tmp_path / name), expected), name


def test_what_is_missing_comes_from_the_paper(tmp_path: Path, model: dict[str, np.ndarray]) -> None:
    np.savez(tmp_path / "plant.npz", **model)
    with pytest.warns(UserWarning, match="there is no E, Q, R, delta; taken: E the identity, Q as in the paper, "):
        game = load_game(str(tmp_path / "plant.npz"))
    assert np.array_equal(game.E, np.eye(6))
    assert np.array_equal(np.diag(game.Q), [1000.0, 1000.0, 0.01, 0.01, 1000.0, 0.01])
    assert np.array_equal(np.diag(game.R), [100.0, 400.0, 400.0, 400.0, 50.0])
    assert game.delta == 200.0


def test_the_paper_s_game_on_a_plant_in_meters(tmp_path: Path, model: dict[str, np.ndarray]) -> None:
    """Q T⁻² and T E are the same game; a plant that does not name the aircraft's states is left alone."""
    units = ["m/s", "rad", "rad", "rad/s", "rad", "rad/s"]
    np.savez(tmp_path / "si.npz", **model, states=LINEAR_STATES, state_units=units)
    np.savez(tmp_path / "other.npz", **model, states=[f"s{i}" for i in range(6)], state_units=units)
    si, other = (stored_game(tmp_path / name).game for name in ("si.npz", "other.npz"))
    np.testing.assert_allclose(np.diag(si.Q), [1000.0 / 0.3048**2, 1000.0, 0.01, 0.01, 1000.0, 0.01], rtol=1e-15)
    assert np.array_equal(np.diag(si.E), [0.3048, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert np.array_equal(other.E, np.eye(6))
    assert other.Q[0, 0] == 1000.0


def test_the_wind_s_column_is_named_as_what_it_is(tmp_path: Path, model: dict[str, np.ndarray]) -> None:
    np.savez(tmp_path / "plant.npz", **model, E=np.ones((6, 1)), disturbances=["updraft"], schema="hfa.linear-model/1")
    found = stored_game(tmp_path / "plant.npz")
    assert np.array_equal(found.game.E, np.eye(6))
    assert found.notes == (
        f"{tmp_path / 'plant.npz'}: its E is that of the wind and not used; taken: E the identity, Q as in the paper, "
        "R as in the paper, delta as in the paper",
    )


def test_an_argument_counts_before_the_file(tmp_path: Path) -> None:
    path = _json(tmp_path / "plant.json", {"A": A2, "B": B2, "Q": Q2, "R": R1, "delta": 5.0})
    assert stored_game(path).game.delta == 5.0
    game, *_ = stored_game(path, Q=np.eye(2), R=parse_diagonal("R", "9"), delta=math.inf)
    assert np.array_equal(game.Q, np.eye(2))
    assert game.R[0, 0] == 9.0
    assert np.array_equal(parse_diagonal("Q", "1, 0.5,2e3"), np.diag([1.0, 0.5, 2000.0]))
    assert game.delta == math.inf


def test_another_size_needs_its_own_weights(tmp_path: Path) -> None:
    path = _json(tmp_path / "plant.json", {"A": A2, "B": B2})
    with pytest.raises(BadInputError, match="the model has 2 states and the Q of the paper is for 6; give Q"):
        load_game(path)
    with pytest.raises(BadInputError, match="the model has 1 inputs and the R of the paper is for 5; give R"):
        load_game(path, Q=np.eye(2))
    assert stored_game(path, Q=np.eye(2), R=np.eye(1)).game.delta == 200.0


def test_misnamed_entries_and_defaults_are_noted(tmp_path: Path) -> None:
    path = stored(tmp_path / "plant.npz", A=A2, B=B2, Q=Q2, R=R1, D=[[1.0], [0.0]], gamma=7.0)
    game, notes, *_ = stored_game(path)
    assert game.delta == 200.0
    assert notes == (
        f"{path}: D, gamma not used; a model file holds A, B, E, Q, R, delta",
        f"{path}: there is no E, delta; taken: E the identity, delta as in the paper",
    )
    ours = small(tmp_path / "ours.npz", schema="hfa.linear-model/1", modes=[1.0])
    assert stored_game(ours).notes == ()


def test_a_time_step_is_said_as_the_number_that_it_is(tmp_path: Path) -> None:
    for suffix in (".json", ".mat"):
        with pytest.raises(BadInputError, match=r"plant\.[a-z]*: dt is 0\.1, a model in discrete time"):
            load_game(small(tmp_path / f"plant{suffix}", dt=0.1))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"A": A2, "Q": Q2}, r"there is no B; .* \(found: A, Q\)"),
        ({}, r"there is no A; .*\(the file is empty\)"),
        ([1, 2], "cannot be read as .json .*must be an object"),
        ({"A": "fast", "B": B2}, "A does not consist of rows of real numbers"),
        ({"A": [[1.0, math.nan], [0.0, 1.0]], "B": B2, "Q": Q2, "R": R1}, r"A\[0\]\[1\] is nan"),
        ({"A": A2, "B": B2, "Q": Q2, "R": R1, "delta": [[1.0], 2.0]}, "delta must be one number"),
        ({"A": A2, "B": B2, "Q": Q2, "R": R1, "dt": [[0.1], 2.0]}, "a model in discrete time"),
    ],
)
def test_bad_models_are_refused_in_one_line(tmp_path: Path, content: Any, message: str) -> None:
    path = _json(tmp_path / "plant.json", content)
    with pytest.raises(BadInputError, match=message) as refusal:
        load_game(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)


def test_damaged_files_are_refused_in_one_line(tmp_path: Path) -> None:
    for suffix, damage in ((".json", b""), (".npz", b"PK\x03\x04broken"), (".npz", b""), (".mat", b"PK\x03\x04broken")):
        path = tmp_path / f"plant{suffix}"
        path.write_bytes(damage)
        with pytest.raises(BadInputError, match=r"cannot be read as|is not JSON|there is no A") as refusal:
            load_game(path)
        assert "\n" not in str(refusal.value)


def test_matlab_73_files_say_how_to_save(tmp_path: Path) -> None:
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema 1.00 ."
    (tmp_path / "plant.mat").write_bytes(
        header.ljust(116) + b"\x00" * 8 + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + b"\x00" * 500
    )
    with pytest.raises(BadInputError, match="save with the option -v7"):
        load_game(tmp_path / "plant.mat")


# Critics --------------------------------------------------------------------------------------------------------


def test_critics_are_read_by_what_they_hold(tmp_path: Path) -> None:
    W, P, K = np.arange(21.0), np.eye(6), np.ones((5, 6))
    np.savez(tmp_path / "all.npz", W=W, P=P, K=K)
    savemat(tmp_path / "row.mat", {"W": W})
    savemat(tmp_path / "value.mat", {"P": P, "K": K})
    _json(tmp_path / "gain.json", {"K": K.tolist(), "delta": 200.0, "certificate": {"ok": True}})
    held = {"all.npz": (W, P, K), "row.mat": (W, None, None), "value.mat": (None, P, K), "gain.json": (None, None, K)}
    for name, parts in held.items():
        for read, expected in zip(load_critic(tmp_path / name), parts, strict=True):
            assert read is expected if expected is None else np.array_equal(read, expected)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"A": A2}, r"there is no W, P or K; .* \(found: A\)"),
        ({"W": [[1.0, 2.0], [3.0, 4.0]]}, r"W has shape \(2, 2\); weights are one row or one column"),
        ({"W": [1.0, math.inf]}, r"W\[1\] is inf"),
        ({"P": [1.0, 2.0]}, "P has 1 dimension"),
    ],
)
def test_bad_critics_are_refused_in_one_line(tmp_path: Path, content: Any, message: str) -> None:
    path = _json(tmp_path / "critic.json", content)
    with pytest.raises(BadInputError, match=message) as refusal:
        load_critic(path)
    assert "\n" not in str(refusal.value)


def test_a_structure_is_looked_into_only_where_nothing_stands_outside(tmp_path: Path) -> None:
    inside = {"A": A2, "B": B2, "Q": Q2, "R": R1, "delta": 9.0}
    assert stored_game(_json(tmp_path / "in.json", {"model": inside})).game.delta == 9.0
    with pytest.raises(BadInputError, match="there is no B"):
        stored_game(_json(tmp_path / "half.json", {"A": A2, "model": inside}))
