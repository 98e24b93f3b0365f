"""Functions for continuous time alone, and critics of the other time, refuse in one line that names
what to call.
"""

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa import BadInputError, Game

#: A stable model of two states and an input; GAME is in steps of .1, with a discount.
LINEAR = hfa.LinearModel.of([[0.5, 0.2], [0.0, 0.3]], [[0.0], [1.0]])
GAME = Game(LINEAR.A, LINEAR.B, Q=np.eye(2), R=[1.0], delta=9.0, dt=0.1, discount=0.9)
EXACT = hfa.solve(GAME)
Z = ca.SX.sym("z", 2)
V = ca.Function("V", [Z], [ca.bilin(ca.DM(EXACT.P), Z, Z)])


#: Public name -> a call with the game in discrete time, which is refused.
CONTINUOUS_ONLY = {
    "fly": lambda: hfa.fly(hfa.aircraft(), hfa.trim(hfa.aircraft()), EXACT),
    "track": lambda: hfa.track(LINEAR, EXACT, {"x1": 1.0}),
    "expand": lambda: hfa.expand(LINEAR, EXACT, 3),
}
pytestmark = pytest.mark.usefixtures("folder")


@pytest.mark.parametrize("name", CONTINUOUS_ONLY)
def test_a_game_in_discrete_time_is_refused(name):
    """A function for continuous time alone refuses a game in discrete time in one line, which names
    a function that accepts it, as `hfa.solve`.
    """
    with pytest.raises(BadInputError) as refusal:
        CONTINUOUS_ONLY[name]()
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
    """A critic's file is read if its sample time is that of the game, or if one of the two is
    unknown. Otherwise it is refused.

    stored: sample time in the file, s: True for discrete time with unknown steps, 0 for continuous
      time, None if the file does not state it
    dt: sample time of the game, s: True as above, None for continuous time
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
#: Kind of critic -> a call that verifies one of GAME (discrete) on CONTINUOUS, or the reverse.
VERIFIED_ON_THE_OTHER = {
    "gain": lambda: hfa.verify(GAME, hfa.from_gain(CONTINUOUS, EXACT.K)),
    "network": lambda: hfa.verify(GAME, hfa.from_network(CONTINUOUS, V)),
    "run": lambda: hfa.verify(GAME, hfa.learn(CONTINUOUS)),
    "file": lambda: hfa.verify(CONTINUOUS, str(hfa.learn(GAME).save("steps.npz") or "steps.npz")),
}


@pytest.mark.parametrize("kind", VERIFIED_ON_THE_OTHER)
def test_a_critic_of_a_game_in_the_other_time_is_refused(kind):
    """`hfa.verify` refuses a critic of a continuous-time game for a discrete-time game, and the
    reverse. The message contains the time.
    """
    with pytest.raises(BadInputError, match=r"discrete time|in steps of"):
        VERIFIED_ON_THE_OTHER[kind]()
