"""Every public function that takes a game or its solution: in discrete time it is judged, or
refuses in one line that names what to call.
"""

import importlib
import inspect

import casadi as ca
import numpy as np
import pytest

import controller
import hfa
from hfa import BadInputError, Game

PACKAGES = (
    *("hfa", "hfa.paper", "controller", "verification", "trim", "hfa_aircraft"),
    *("hfa_flight", "hfa_prove", "hfa_identify"),
)
#: A stable model of two states and an input; GAME is in steps of .1, with a discount.
LINEAR = hfa.LinearModel.of([[0.5, 0.2], [0.0, 0.3]], [[0.0], [1.0]])
GAME = Game(LINEAR.A, LINEAR.B, Q=np.eye(2), R=[1.0], delta=9.0, dt=0.1, discount=0.9)
EXACT = hfa.solve(GAME)
WEIGHTS = np.array([EXACT.P[0, 0], 2.0 * EXACT.P[0, 1], EXACT.P[1, 1]])
Z = ca.SX.sym("z", 2)
V = ca.Function("V", [Z], [ca.bilin(ca.DM(EXACT.P), Z, Z)])


#: Functions that accept games in both times: tests/controller/riccati compares their answers.
SOLVED = {"Solution", "solve", "minimum_delta"}
#: Functions that accept games in both times: tests/verification/critic judges their critics.
JUDGED = {"learn", "verify", "Verdict", "from_gain", "from_value", "from_weights", "from_network"}
JUDGED |= {"read_critic", "critic_in", "solution_report"}
#: Public name -> a call with the game in steps, which is refused.
REFUSED = {
    "fly": lambda: hfa.fly(hfa.aircraft(), hfa.trim(hfa.aircraft()), EXACT),
    "track": lambda: hfa.track(LINEAR, EXACT, {"x1": 1.0}),
    "expand": lambda: hfa.expand(LINEAR, EXACT, 3),
    "Expansion": lambda: hfa.expand(LINEAR, EXACT, 3),
    "random_pool": lambda: controller.random_pool(GAME, 9, 0),
}
pytestmark = pytest.mark.usefixtures("folder")


def test_the_tables_have_every_function_that_takes_a_game():
    """Each public function with an argument of the type Game or Solution is in one of the tables."""
    found = set()
    for package in map(importlib.import_module, PACKAGES):
        for name in dir(package):
            value = getattr(package, name)
            if callable(value) and not name.startswith("_"):
                try:
                    parameters = inspect.signature(value).parameters.values()
                except (TypeError, ValueError):
                    continue
                kinds = {str(parameter.annotation).split(" |")[0] for parameter in parameters}
                found |= {name} if kinds & {"Game", "Solution"} else set()
    # The policy of `fly` may be a solution, among others.
    assert found | {"fly"} == SOLVED | JUDGED | REFUSED.keys()


@pytest.mark.parametrize("name", REFUSED)
def test_a_game_in_discrete_time_is_refused(name):
    """Each function of `REFUSED` refuses a game in steps in one line with the functions that accept
    it.
    """
    with pytest.raises(BadInputError) as refusal:
        REFUSED[name]()
    assert "requires a game in continuous time" in str(refusal.value)
    assert "hfa.solve" in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("stored", "dt", "is_read"),
    [
        (0.05, None, False),
        (0.05, 0.1, False),
        (True, None, False),
        (0.05, 0.05, True),
        (0.05, True, True),
        (True, 0.1, True),
        (0.0, None, True),
        (None, 0.1, True),
    ],
)
def test_a_gain_for_another_step_is_refused(stored, dt, is_read):
    """A critic's file is read if its sample time is that of the game, or one of the two is unknown.

    stored: sample time in the file: True of unknown steps, 0 in continuous time, None if not stated
    dt: that of the game, None in continuous time
    """
    entries = {} if stored is None else {"dt": stored}
    np.savez("K.npz", K=EXACT.K, **entries)
    game = Game(LINEAR.A, LINEAR.B, Q=np.eye(2), R=[1.0], delta=9.0, dt=dt)
    if is_read:
        np.testing.assert_array_equal(hfa.read_critic("K.npz", game).K, EXACT.K)
        return
    with pytest.raises(BadInputError, match="give a policy of this game"):
        hfa.read_critic("K.npz", game)


CONTINUOUS = Game(LINEAR.A, LINEAR.B, Q=np.eye(2), R=[1.0], delta=9.0)
#: What is judged on a game in the other kind of time.
OF_THE_OTHER = {
    "gain": lambda: hfa.verify(GAME, hfa.from_gain(CONTINUOUS, EXACT.K)),
    "value": lambda: hfa.verify(CONTINUOUS, hfa.from_value(GAME, EXACT.P)),
    "weights": lambda: hfa.verify(CONTINUOUS, hfa.from_weights(GAME, WEIGHTS)),
    "network": lambda: hfa.verify(GAME, hfa.from_network(CONTINUOUS, V)),
    "solution": lambda: hfa.verify(CONTINUOUS, EXACT),
    "run": lambda: hfa.verify(GAME, hfa.learn(CONTINUOUS)),
    "file": lambda: hfa.verify(CONTINUOUS, str(hfa.learn(GAME).save("steps.npz") or "steps.npz")),
    "other file": lambda: hfa.verify(GAME, str(hfa.learn(CONTINUOUS).save("c.json") or "c.json")),
}


@pytest.mark.parametrize("kind", OF_THE_OTHER)
def test_a_critic_of_the_other_time_is_refused(kind):
    """`hfa.verify` refuses a critic in continuous time for a game in steps, and the reverse, with
    the time in the message.
    """
    with pytest.raises(BadInputError, match=r"discrete time|in steps of"):
        OF_THE_OTHER[kind]()
