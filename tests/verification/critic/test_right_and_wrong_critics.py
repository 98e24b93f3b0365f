"""Critics by every way in, of games in every time: the right ones pass, the wrong ones fail.

No reason names a mistake that was not made.
"""

from functools import cache, partial
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from game_files import stored
from game_samples import in_steps
from network_files import torch_file

import hfa
from controller import basis
from hfa import solve

pytestmark = pytest.mark.usefixtures("folder")
#: Number of flights of a critic that is simulated; the default takes longer.
FAST = 4


class Case(NamedTuple):
    """A game with its exact solution."""

    game: hfa.Game
    P: np.ndarray
    K: np.ndarray

    @property
    def W(self):
        """Weights of the exact P in the quadratic basis."""
        return basis("quadratic", len(self.P)).weights(self.P)


#: Time -> game in the first line.
GAMES = {"continuous": "linear", "discrete": "discrete", "sampled": "sampled"}


@cache
def case_of(time):
    """Return the game in continuous time, in discrete time, or sampled, with 3 states and 2 inputs."""
    rng = np.random.default_rng(4)
    A, B, E = (rng.standard_normal((3, columns)) for columns in (3, 2, 1))
    Q, R = np.diag([1.0, 2.0, 0.5]), np.diag([1.0, 0.6])
    game = hfa.Game(A, B, E=0.3 * E, Q=Q, R=R, delta=4.0)
    if time == "discrete":
        step = hfa.Game(np.eye(3) + 0.15 * A, 0.3 * B, E=0.1 * E, Q=Q, R=R, delta=30.0)
        game = in_steps(step, 0.97)
    if time == "sampled":
        game = hfa.Game(A, B, E=0.3 * E, Q=Q, R=R, delta=4.0).sampled(0.05, 0.999)
    exact = solve(game)
    return Case(game, exact.P, exact.K)


def read(case, basis=None, **arrays):
    """Return the critic of a file with arrays."""
    return hfa.read_critic(stored("critic.npz", **arrays), case.game, basis=basis)


def network(case, **layers):
    """Return the critic of a network of u: one affine layer, or two with tanh between them.

    layers: "weight", "bias", "0_weight", "2_weight" -> array
    """
    named = {name.replace("_", "."): array for name, array in layers.items()}
    path = torch_file("critic.pt", named)
    activation = "tanh" if len(layers) > 1 and "0.weight" in named else None
    return hfa.from_network(case.game, path, network="policy=", activation=activation)


def function(case, kind):
    """Return the critic of the exact functions of a kind, with 3 added to V."""
    z = ca.SX.sym("z", 3)
    V, u = ca.bilin(ca.DM(case.P), z, z) + 3.0, -ca.DM(case.K) @ z
    outputs = {"V": V, "gradient": ca.gradient(V, z), "V+policy": ca.vertcat(V, u)}
    return hfa.from_network(case.game, ca.Function("f", [z], [outputs[kind]]), network=kind)


#: Way in which a right critic is given -> function that makes it.
RIGHT = {
    "P": lambda case: hfa.from_value(case.game, case.P),
    "K": lambda case: hfa.from_gain(case.game, case.K),
    "W": lambda case: hfa.from_weights(case.game, case.W),
    "listed": lambda case: hfa.from_weights(
        case.game, case.W, basis="x1**2, x1*x2, x1*x3, x2**2, x2*x3, x3**2"
    ),
    "quartic basis": lambda case: hfa.from_weights(
        case.game, np.append(case.W, [0.0] * 3), basis="quadratic+quartic"
    ),
    "network of u": lambda case: network(case, weight=-case.K),
    **{kind: partial(function, kind=kind) for kind in ("V", "gradient", "V+policy")},
}
#: Ways whose critics are simulated.
FLOWN = ("network of u", "V", "gradient", "V+policy", "listed")
#: Mistake -> critic, and words of which the reason contains one. Without words, there is no reason.
WRONG = {
    "biased": (lambda case: network(case, weight=-case.K, bias=np.ones(2)), ("at the origin",)),
    "half a network": (
        lambda case: network(
            case, **{"0_weight": 1e-3 * np.eye(3), "2_weight": -1e3 * case.K * [1, 0, 1]}
        ),
        (),
    ),
    "quartic tail": (
        lambda case: read(
            case, "quadratic+quartic", W=np.append(case.W, [50.0 * case.P[0, 0], 0.0, -40.0])
        ),
        ("weight",),
    ),
    "saturated": (
        lambda case: network(case, **{"0_weight": 10 * case.K, "2_weight": -0.1 * np.eye(2)}),
        (),
    ),
}


#: Ways and mistakes of a V that is not quadratic and has no policy: in continuous time alone.
WITHOUT_POLICY = ("listed", "V", "gradient", "quartic tail")


def in_each_time(kinds):
    """Return each kind in each time."""
    return [
        (kind, time)
        for kind in kinds
        for time in GAMES
        if time == "continuous" or kind not in WITHOUT_POLICY
    ]


@pytest.mark.parametrize("kind", WITHOUT_POLICY)
def test_a_value_without_a_policy_is_refused_in_discrete_time(kind):
    """No policy is computed from a V that is not a quadratic form of the states in a basis."""
    made = RIGHT.get(kind) or WRONG[kind][0]
    with pytest.raises(hfa.BadInputError, match="no policy is computed from a V"):
        made(case_of("discrete"))


@pytest.mark.parametrize(("way", "time"), in_each_time(RIGHT))
def test_a_right_critic_passes(way, time):
    """A right critic passes without a reason, in whichever way of `RIGHT` it is given. Only networks,
    functions and listed bases (`FLOWN`) are simulated.
    """
    case = case_of(time)
    verdict = hfa.verify(case.game, RIGHT[way](case), flights=FAST)
    assert verdict.ok, str(verdict)
    assert verdict.headline.startswith(f"PASS on the {GAMES[time]} game, balanced box")
    assert verdict.reason == ""
    assert (verdict.flights is None) == (way not in FLOWN)


@pytest.mark.parametrize(("mistake", "time"), in_each_time(WRONG))
def test_a_wrong_critic_fails_for_the_right_reason(mistake, time):
    """A critic with a mistake fails, and its reason contains one of the words that `WRONG` lists for
    the mistake, or is "" if it lists none.
    """
    case = case_of(time)
    critic, reasons = WRONG[mistake]
    verdict = hfa.verify(case.game, critic(case), flights=FAST)
    assert not verdict.ok
    named = any(words in verdict.reason for words in reasons)
    assert named if reasons else verdict.reason == ""
