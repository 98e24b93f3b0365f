"""Plant files of users: reading, defaults for missing entries, and refusal of faulty entries."""

import math
import re
import warnings

import numpy as np
import pytest
from cli import refused
from game_files import small, stored

from controller import load_game
from hfa import BadInputError, Game, read_critic

A2 = [[0.0, 1.0], [-2.0, -3.0]]
B2 = [[0.0], [1.0]]
PLANT = {"A": A2, "B": B2, "Q": [[2.0, 0.0], [0.0, 1.0]], "R": [[4.0]]}
pytestmark = pytest.mark.usefixtures("folder")


# Plants
# --------------------------------------------------------------------------------------------------


def test_misnamed_entries_and_defaults_are_noted():
    """Notes list the unused entries, the defaults, and an E that describes wind and is not used."""
    game, notes = noted(stored("plant.npz", **PLANT, D=[[1.0], [0.0]], C=np.eye(2)))
    assert game == Game(**PLANT, E=np.eye(2), delta=math.inf)
    assert "unused: C, D;" in notes
    assert "not given: E, delta; used: E the identity, delta inf" in notes
    assert noted(small("ours.npz", schema="hfa.linear-model/1", modes=[1.0]))[1] == ""
    wind = stored(
        "wind.npz", **PLANT, E=[[1.0], [1.0]], disturbances=["updraft"], schema="hfa.linear-model/1"
    )
    game, notes = noted(wind, delta=200.0)
    assert game == Game(**PLANT, E=np.eye(2), delta=200.0)
    assert "E describes the wind and is not used" in notes


@pytest.mark.parametrize(
    ("entries", "dt"),
    [
        ({"Ts": 0.1}, 0.1),
        ({"Ts": [[-1.0]]}, True),
        ({"Ts": 0.0}, None),
        ({"Ts": 0.1, "dt": 0.1}, 0.1),
        ({"Ts": 0.1, "dt": 0.2}, "dt and Ts"),
        ({"Ts": -0.1}, "Ts is -0.1"),
        ({"Ts": 0.1, "time": "continuous"}, "dt denotes discrete time"),
    ],
)
def test_the_sample_time_of_matlab_is_read(entries, dt):
    """Ts is the sample time of a plant, and of a gain, which is refused for another time."""
    path = stored("plant.json", system=PLANT | entries)
    if isinstance(dt, str):
        with pytest.raises(BadInputError, match=dt):
            load_game(path)
        return
    game, notes = noted(path)
    assert game.dt == dt
    assert "Ts" not in notes
    gain = stored("K.json", K=[[0.0, 0.0]], **entries)
    assert np.array_equal(read_critic(gain, game).K, np.zeros((1, 2)))
    if dt is not None:
        with pytest.raises(BadInputError, match="but the game is in continuous time"):
            read_critic(gain, Game(**PLANT, E=np.eye(2), delta=math.inf))


def noted(path, **changes):
    """Return the game in a file, and the warnings issued, a line each."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        game = load_game(path, **changes)
    return game, "\n".join(str(each.message) for each in caught)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"A": A2, "Q": A2}, r"there is no B; .* \(found: A, Q\)"),
        ({}, r"there is no A; .*\(the file is empty\)"),
        (
            {"A": A2, "B": B2},
            r"there is no Q; give Q \(2 x 2\)",
        ),
        (
            PLANT | {"states": ["a\x1b[31m", "b"]},
            "states contains .* which cannot be printed",
        ),
        (
            PLANT | {"delta": 2.0, "Gamma": 0.98, "dt": 0.1},
            "unknown entry 'Gamma'",
        ),
        (PLANT | {"dt": 0.1, "time": "continuous"}, "dt denotes discrete time, but"),
        (PLANT | {"discount": 0.9}, "discount requires a game in discrete time"),
        (PLANT | {"time": "later"}, 'time is later; give "continuous" or "discrete"'),
        ({"A": A2, "B": B2, "Q": np.eye(2)}, r"there is no R; give R \(1 x 1\)"),
        (PLANT | {"delta": [1.0, 2.0]}, "delta"),
        (PLANT | {"dt": True, "discount": True}, "discount does not consist of"),
        (PLANT | {"Q": [[[1], 2]]}, "Q does not consist of rows of real numbers"),
        (PLANT | {"B1": B2, "C1": A2, "D12": B2}, r"B1, C1, D12 are of another convention"),
        ({"A": A2, "B1": B2, "B2": B2, "C1": A2}, r"give instead B \(its B, or B2\), E = B1"),
        (PLANT | {"C": A2, "D": B2, "E": A2}, "E beside C and D may be MATLAB's descriptor"),
    ],
)
def test_bad_entries_are_refused_in_one_line(content, message):
    """Each faulty plant file is refused by one line that names the file and the fault."""
    assert re.search(f"^a.json: .*{message}", refused(load_game, stored("a.json", **content)))
