"""Plant files of users: reading, defaults for missing entries, and refusal of faulty entries."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from game_files import small, stored
from scipy.sparse import csc_matrix

from controller import load_game
from controller.game.game_file import stored_game
from controller.hfa_files import paper_defaults
from hfa import BadInputError, Game
from hfa.options.game import diagonal
from hfa_aircraft.names import PlantNames
from hfa_aircraft.readers.matrices_file import file_scales
from hfa_model import LINEAR_STATES, published_models

A2 = [[0.0, 1.0], [-2.0, -3.0]]
B2 = [[0.0], [1.0]]
PLANT: dict[str, Any] = {"A": A2, "B": B2, "Q": [[2.0, 0.0], [0.0, 1.0]], "R": [[4.0]]}
MODEL: dict[str, Any] = {"A": published_models()[0].A, "B": published_models()[0].B}
pytestmark = pytest.mark.usefixtures("folder")


# Plants
# --------------------------------------------------------------------------------------------------


def test_every_format_gives_the_same_game() -> None:
    """Every file format gives the same game and the same record of its origin."""
    full = MODEL | {
        "E": np.eye(6)[:, :2],
        "Q": 2.0 * np.eye(6),
        "R": 3.0 * np.eye(5),
        "delta": 321.0,
    }
    block = {"version": "1.2", "parameters": "ab12"}
    flat = {f"provenance.{name}": word for name, word in block.items()}
    for path in (
        stored("plant.npz", **full, **flat),
        stored("plant.json", **full, provenance=block),
        stored("sparse.MAT", **full | {"A": csc_matrix(full["A"])}, provenance=block),
    ):
        stored_problem = stored_game(path)
        assert stored_problem.game == Game(**full)
        assert stored_problem.provenance == block


def test_the_papers_game_is_converted_to_meters() -> None:
    """For a plant in meters, the paper's Q and E are converted from feet.

    A plant with other state names has no default for Q. A plant without names that has its own Q
    and R gets E = I and delta = inf.
    """
    units = ["m/s", "rad", "rad", "rad/s", "rad", "rad/s"]
    stored("si.npz", **MODEL, states=LINEAR_STATES, state_units=units)
    stored("other.npz", **MODEL, states=[f"s{i}" for i in range(6)], state_units=units)
    si = stored_game("si.npz", defaults=paper_defaults).game
    np.testing.assert_allclose(
        np.diag(si.Q), [1000.0 / 0.3048**2, 1000.0, 0.01, 0.01, 1000.0, 0.01], rtol=1e-15
    )
    assert np.array_equal(np.diag(si.E), [0.3048, 1.0, 1.0, 1.0, 1.0, 1.0])
    with pytest.raises(BadInputError, match=r"there is no Q; give Q \(6 x 6\)"):
        load_game("other.npz")
    for names, more, is_known in (
        (PlantNames(), {}, True),
        (PlantNames(), {"Q": np.eye(6)}, True),
        (PlantNames(), {"Q": np.eye(6), "R": np.eye(5)}, False),
        (PlantNames(LINEAR_STATES), {"Q": np.eye(6), "R": np.eye(5)}, True),
        (PlantNames((), ("a", "b", "c", "d", "e")), {}, False),
    ):
        assert bool(paper_defaults(MODEL | more, names).values) is is_known
    weights = {"Q": np.eye(6), "R": np.eye(5)}
    stored("weighed.npz", **MODEL, **weights)
    with pytest.warns(UserWarning, match="used: E the identity, delta inf"):
        assert load_game("weighed.npz") == Game(**MODEL, E=np.eye(6), **weights, delta=math.inf)


def test_arguments_override_entries_of_the_file() -> None:
    """Arguments Q, R and delta override the entries of the plant file.

    The text "inf" is read as delta = inf.
    """
    path = stored("plant.json", **PLANT, delta=5.0)
    assert stored_game(path).game.delta == 5.0
    assert stored_game(stored("inf.json", **PLANT, delta="inf")).game.delta == math.inf
    game, *_ = stored_game(path, Q=np.eye(2), R=diagonal("9"), delta=math.inf)
    assert game == Game(**PLANT | {"E": np.eye(2), "Q": np.eye(2), "R": [[9.0]], "delta": math.inf})
    assert np.array_equal(diagonal("1, 0.5,2e3"), np.diag([1.0, 0.5, 2000.0]))


def test_misnamed_entries_and_defaults_are_noted() -> None:
    """Notes list the unused entries, the defaults, and an E that describes wind and is not used."""
    game, notes, *_ = stored_game(stored("plant.npz", **PLANT, D=[[1.0], [0.0]], gamma=7.0))
    assert game == Game(**PLANT, E=np.eye(2), delta=math.inf)
    assert notes == (
        "plant.npz: unused: D, gamma; a model file contains A, B, E, Q, R, delta, N",
        "plant.npz: not given: E, delta; used: E the identity, delta inf (no disturbance)",
    )
    assert stored_game(small("ours.npz", schema="hfa.linear-model/1", modes=[1.0])).notes == ()
    wind = stored(
        "wind.npz", **PLANT, E=[[1.0], [1.0]], disturbances=["updraft"], schema="hfa.linear-model/1"
    )
    game, notes, *_ = stored_game(wind, delta=200.0)
    assert game == Game(**PLANT, E=np.eye(2), delta=200.0)
    assert notes == (
        "wind.npz: E describes the wind and is not used",
        "wind.npz: not given: E; used: E the identity",
    )


def test_structures_are_read_if_top_level_is_empty() -> None:
    """Matrices are read from a structure in a plant file only if the top level contains none."""
    inside = PLANT | {"delta": 9.0}
    assert stored_game(stored("in.json", model=inside)).game.delta == 9.0
    with pytest.raises(BadInputError, match="there is no B"):
        stored_game(stored("half.json", A=A2, model=inside))


@pytest.mark.parametrize(
    ("load", "content", "message"),
    [
        (load_game, {"A": A2, "Q": A2}, r"there is no B; .* \(found: A, Q\)"),
        (load_game, {}, r"there is no A; .*\(the file is empty\)"),
        (load_game, PLANT | {"B": [[0.0, 1.0]]}, "B is 1 x 2; give 2 x 2, to match A and B"),
        (
            load_game,
            {"A": A2, "B": B2},
            r"there is no Q; give Q \(2 x 2\)",
        ),
        (
            load_game,
            {"A": A2, "B": B2, "Q": A2},
            r"there is no R; give R \(1 x 1\)",
        ),
        (
            load_game,
            PLANT | {"states": ["a\x1b[31m", "b"]},
            "states contains .* which cannot be printed",
        ),
        (
            load_game,
            PLANT | {"input_labels": ["a\nb"]},
            "inputs contains .* which cannot be printed",
        ),
        (load_game, PLANT | {"delta": [1.0, 2.0]}, "delta has 2 elements; give a single number"),
        (load_game, PLANT | {"dt": -0.1}, "dt is -0.1; give the sample time in s"),
        (load_game, PLANT | {"dt": 0.1, "time": "continuous"}, "dt denotes discrete time, but"),
    ],
)
def test_bad_entries_are_refused_in_one_line(
    load: Callable[[str], Any], content: Any, message: str
) -> None:
    """Each faulty plant file is refused by one line that names the file and the fault."""
    with pytest.raises(BadInputError, match=f"^a.json: .*{message}") as refusal:
        load(stored("a.json", **content))
    assert "\n" not in str(refusal.value)


MATLAB_73 = (
    b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024 HDF5 schema"
    b" 1.00 ."
)
VERSION_73 = b"\x00" * 8 + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + b"\x00" * 500


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("plant.json", b"", "is not JSON"),
        ("plant.json", b"[1, 2]", "cannot be read as .json .*is not an object"),
        ("plant.npz", b"PK\x03\x04broken", "cannot be read as .npz"),
        ("plant.mat", MATLAB_73.ljust(116) + VERSION_73, "save with the option -v7"),
    ],
)
def test_damaged_files_are_refused_in_one_line(name: str, content: bytes, said: str) -> None:
    """A damaged file of each format is refused by one line."""
    Path(name).write_bytes(content)
    with pytest.raises(BadInputError, match=said) as refusal:
        load_game(name)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            {"state_units": ["ft/s", "kg"]},
            "state 2 is in kg in the file but in rad in the plant; convert the matrices",
        ),
        (
            {"states": ["alpha", "speed"]},
            "the states are alpha, speed in the file, but in the plant speed, alpha; reorder",
        ),
        (
            {"inputs": ["alpha", "speed"]},
            "the inputs are alpha, speed in the file, but in the plant speed, alpha; reorder",
        ),
    ],
)
def test_other_units_and_another_order_are_refused(
    content: dict[str, list[str]], said: str
) -> None:
    """Units that cannot be converted, and names in another order than the plant's, are refused."""
    plant = PlantNames(("speed", "alpha"), ("speed", "alpha"), ("ft/s", "rad"))
    with pytest.raises(BadInputError, match=said):
        file_scales(content, plant)
    scales = file_scales({"state_units": ["m/s", "deg"]}, plant)
    np.testing.assert_allclose(scales, [0.3048, 180.0 / np.pi])
