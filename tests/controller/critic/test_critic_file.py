"""Reading of critic files with W, P and K, and refusal of faulty files."""

import re
from dataclasses import replace

import numpy as np
import pytest
from cli import refused
from game_files import stored
from tolerances import FEW_ROUNDINGS

import hfa
from controller import critic_in
from hfa import BadInputError, Game, LinearModel
from hfa.extend import Reading

#: Game with two states and two inputs. V has 3 weights of the quadratic basis.
GAME = Game(
    [[0.0, 1.0], [-2.0, -3.0]],
    [[0.0, 1.0], [1.0, 3.0]],
    E=np.eye(2),
    Q=[[2.0, 0.0], [0.0, 1.0]],
    R=[[4.0, 1.0], [1.0, 2.0]],
    delta=10.0,
)
I2 = np.eye(2)
K = np.arange(12.0).reshape(3, 2, 2)
pytestmark = pytest.mark.usefixtures("folder")


#: The game in discrete time, in which a file may have H.
STEPS = replace(GAME, A=0.2 * GAME.A, dt=True)
SKEW = np.eye(4) + np.triu(np.ones((4, 4)), 1)  # not symmetric


@pytest.mark.parametrize(
    ("game", "content", "message"),
    [
        (GAME, {"A": np.eye(2)}, r"the file contains no W, P or K; .* \(found: A\)"),
        (GAME, {"W": [[1.0, 2.0], [3.0, 4.0]]}, r"W has shape .2, 2., one for each time"),
        (GAME, {"P": [1.0, 2.0]}, "the number of dimensions of P is 1; give 2"),
        (GAME, {"P": np.ones((4, 2, 2))}, "one for each time; give one"),
        (GAME, {"K": np.ones((4, 2, 2))}, "K is a table of gains"),
        (GAME, {"P": I2, "policy_weights": np.ones((2, 4))}, "give a column for each monomial"),
        (GAME, {"P": I2, "policy_weights": np.ones((1, 2))}, "give one for each of the 2 inputs"),
        (GAME, {"W": [1.0], "basis": "__import__('os')"}, "is not supported; use x1 to x2"),
        (GAME, {"W": np.ones(5), "basis": ["quadratic", "paper"]}, "entry basis is not one name"),
        (GAME, {"W": np.ones(7)}, "give the basis cubic$"),
        (GAME, {"W": np.ones(4)}, "give 3 weights, P or a list of functions as the basis$"),
        (STEPS, {"K": I2, "schema": "hfa.game-solution/1"}, "a policy in continuous time"),
        (STEPS, {"K": I2, "time": "continuous"}, "a policy in continuous time"),
        (STEPS, {"H": np.eye(5)}, r"give 4 x 4 over \(x, u\) or 6 x 6 over \(x, u, w\)"),
        (STEPS, {"H": SKEW}, r"not symmetric; give \(H \+ H'\)/2"),
        (STEPS, {"H": np.diag([1.0, 1.0, 1.0, 0.0])}, "is singular"),
    ],
)
def test_bad_entries_are_refused_in_one_line(game, content, message):
    """Each faulty critic file is refused by one line that names the file and the fault."""
    said = refused(critic_in, stored("a.json", **content), game)
    assert re.search(f"^a.json: .*{message}", said)


def test_functions_of_a_critic_follow_its_matrices():
    """V, ∂V/∂z and u of weights are V = W'ψ, its derivative, and u = -½ R⁻¹B' ∂V/∂z.

    A critic of a gain has no V, and the policy u = -K z.
    """
    z = np.array([0.3, -0.2])
    weights = np.array([1.0, 2.0, 3.0, 0.5, 0.0])  # of x², xy, y², x⁴, y⁴
    critic = critic_in(stored("w.npz", W=weights), GAME, reading=Reading("quadratic+quartic"))
    x, y = z
    value = x**2 + 2 * x * y + 3 * y**2 + 0.5 * x**4
    slopes = np.array([2 * x + 2 * y + 2 * x**3, 2 * x + 6 * y])
    assert float(critic.value(z)) == pytest.approx(value, rel=FEW_ROUNDINGS)
    assert np.array(critic.gradient(z)).ravel() == pytest.approx(slopes, rel=FEW_ROUNDINGS)
    u = -0.5 * np.linalg.solve(GAME.R, GAME.B.T @ slopes)
    assert np.array(critic.policy(z)).ravel() == pytest.approx(u, rel=FEW_ROUNDINGS)
    gain = critic_in(stored("k.npz", K=K[1]), GAME)
    assert gain.value is None
    assert np.array(gain.policy(z)).ravel() == pytest.approx(-K[1] @ z, rel=FEW_ROUNDINGS)


#: Units of a plant, other units of a file, and numbers of a file's units in a unit of the plant.
OF_PLANT = {"state_units": ("m/s", "rad"), "input_units": ("N", "rad")}
OF_FILE = {"state_units": ["kt", "deg"], "input_units": ["lbf", "deg"]}
PER_STATE = np.array([3600.0 / 1852.0, 180.0 / np.pi])
PER_INPUT = np.array([1.0 / 4.4482216152605, 180.0 / np.pi])
CRITICS = {
    "gain": {"K": [[1.0, -2.0], [3.0, 0.5]]},
    "value": {"P": [[2.0, 0.3], [0.3, 1.0]]},
    "weights": {"W": np.arange(5.0) + 1.0, "basis": "quadratic+linear"},
    "listed functions": {"W": [1.0, 2.0], "basis": "x1**2 + x2**2, x2**4"},
    "value and policy": {"P": I2, "policy_weights": np.arange(10.0).reshape(2, 5)},
    "Q with disturbances": {"H": np.diag([4.0, 3.0, 2.0, 5.0, -9.0, -8.0]) + 0.1},
}


def in_units_of_file(game):
    """Return a game in the units of the file."""
    names = game.names._replace(**{key: tuple(units) for key, units in OF_FILE.items()})
    return replace(
        game,
        A=np.diag(PER_STATE) @ game.A / PER_STATE,
        B=np.diag(PER_STATE) @ game.B / PER_INPUT,
        E=np.diag(PER_STATE) @ game.E,
        Q=game.Q / np.outer(PER_STATE, PER_STATE),
        R=game.R / np.outer(PER_INPUT, PER_INPUT),
        names=names,
    )


@pytest.mark.parametrize("kind", CRITICS)
def test_a_critic_means_the_same_in_all_units(kind):
    """A critic in a file in kt, deg and lbf is converted for a plant in m/s, rad and N.

    At a state z in the plant's units, u and V equal those of the critic that is read without
    conversion (`own`), for the game in the file's units, at the state PER_STATE z. The matrices L of
    d = L z, without units of d, and H of Q(x, u, w) are converted, too, where a critic has them.
    """
    game = STEPS if "H" in CRITICS[kind] else GAME
    game = replace(game, names=game.names._replace(**OF_PLANT))
    path = stored("critic.npz", **CRITICS[kind], **OF_FILE)
    found, own = critic_in(path, game), critic_in(path, in_units_of_file(game))
    for z in np.array([[0.3, -0.2], [0.01, 0.4]]):
        np.testing.assert_allclose(found.u(z) * PER_INPUT, own.u(PER_STATE * z), rtol=1e-9)
        if own.value is not None:
            assert float(found.value(z)) == pytest.approx(float(own.value(PER_STATE * z)))
    if own.L is not None:
        np.testing.assert_allclose(found.L, own.L * PER_STATE, rtol=1e-9)
    if own.H is not None:
        sizes = np.concatenate([PER_STATE, PER_INPUT, np.ones(len(own.H) - 4)])
        np.testing.assert_allclose(found.H, own.H * np.outer(sizes, sizes), rtol=1e-12)


ONE = Game([[0.0, 1.0], [2.0, -0.3]], [[0.0], [1.0]], Q=np.eye(2), R=[1.0])
ONE = replace(
    ONE,
    names=ONE.names._replace(
        states=("speed", "alpha"),
        inputs=("push",),
        state_units=("m/s", "rad"),
        input_units=("N",),
    ),
)


@pytest.mark.parametrize("poles", [{"e": [-1.0, -2.0]}, {"P": [[-1.0 + 1j], [-1.0 - 1j]]}])
def test_the_results_of_lqr_of_matlab_are_k_and_p(poles):
    """Of [K, S, e] or [K, S, P] = lqr(...) in a file, S is read as the matrix P of the value.

    MATLAB's P are the poles.
    """
    np.savez("lqr.npz", K=[[4.0, 3.0]], S=[[2.0, 1.0], [1.0, 5.0]], **poles)
    found = critic_in("lqr.npz", ONE)
    assert found.K.tolist() == [[4.0, 3.0]]
    assert found.P.tolist() == [[2.0, 1.0], [1.0, 5.0]]


def test_a_gain_of_one_input_may_be_a_vector():
    """K (n,) in a file and as an array is K (1, n) for one input; for two inputs it is refused."""
    np.savez("k.npz", K=[4.0, 3.0])
    for found in (critic_in("k.npz", ONE), hfa.from_gain(ONE, [4.0, 3.0])):
        assert found.K.tolist() == [[4.0, 3.0]]
    with pytest.raises(BadInputError, match="dimensions of K is 1; give 2"):
        critic_in("k.npz", GAME)


class Tensor:
    """What PyTorch gives for a tensor that requires a gradient."""

    def __init__(self, numbers):
        self.numbers = numbers

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("Can't call numpy() on Tensor that requires grad")

    def detach(self):
        return self

    def cpu(self):
        return self.numbers


@pytest.mark.parametrize("kind", [Tensor, np.asarray, np.ndarray.tolist, "series", "frame"])
def test_a_gain_is_accepted_in_each_form(kind):
    """`verify` and `from_gain` accept K as a tensor, array, list, and Series or frame of pandas.

    The labels of Series and frame are in reverse order.
    """
    exact = hfa.solve(ONE).K
    if isinstance(kind, str):
        pandas = pytest.importorskip("pandas")
        row = pandas.Series(exact[0], ONE.names.states).iloc[::-1]
        given = row if kind == "series" else row.to_frame(ONE.names.inputs[0]).T
    else:
        given = kind(exact)
    assert hfa.verify(ONE, given).ok
    assert np.array_equal(hfa.from_gain(ONE, given).K, exact)


def test_h_is_read_in_the_order_that_its_file_lists():
    """An H over (u, x), an order that the file's entry H_signals lists by blocks or by names, gives the
    K of the H over (x, u), the order without this entry. Names that are no signals are refused.
    """
    H = np.diag([8.0, 6.0, 4.0, 10.0]) + np.add.outer(range(4), range(4)) / 10.0
    own = critic_in(stored("own.json", H=H), STEPS)
    places = [2, 3, 0, 1]  # (u, x) in (x, u), with two states and two inputs
    names = [*STEPS.names.inputs, *STEPS.names.states]
    for signals in (["u", "x"], names):
        turned = stored("turned.json", H=H[np.ix_(places, places)], H_signals=signals)
        np.testing.assert_array_equal(critic_in(turned, STEPS).K, own.K)
    with pytest.raises(BadInputError, match="H_signals lists u, z; give the blocks x, u, w, or"):
        critic_in(stored("odd.json", H=H, H_signals=["u", "z"]), STEPS)


OF_GAME = {name: getattr(GAME, name) for name in ("A", "B", "E", "Q", "R", "delta")}


@pytest.mark.parametrize(
    ("entries", "note"),
    [
        ({}, ""),
        ({"states": ["Angle", "rate"]}, ""),
        ({"states": ["angel", "rate"]}, "states angel, rate of the file, taken as angle, rate"),
        (OF_GAME | {"Q": np.diag(GAME.Q), "discount": 1.0}, ""),
        *(({name: 1.01 * entry}, "of the file is not") for name, entry in OF_GAME.items()),
        ({"discount": 0.9}, "discount 0.9 of the file is not that of the game"),
        ({"Q": np.eye(3)}, "Q of the file is not"),
        ({"seed": 1, "schema": "mine"}, "unused: schema, seed; read: K"),
        ({"L": np.eye(2), "basis": "cubic"}, "unused: L, basis"),
    ],
)
def test_each_entry_of_a_file_is_used_compared_or_noted(entries, note):
    """Notes of a file with K name states that differ from the plant's, matrices that differ from the
    game's, and entries that are not used. Without notes, the report's data have no entry `declared`.
    """
    plant = LinearModel.of(GAME.A, GAME.B, states=("angle", "rate"), inputs=("roll", "pitch"))
    named = hfa.game(plant, Q=GAME.Q, R=GAME.R, E=GAME.E, delta=GAME.delta)
    np.savez("K.npz", K=np.eye(2), **entries)
    told = hfa.verify(named, hfa.read_critic("K.npz", named)).report()
    assert note in " ".join(told.text().split())
    assert ("declared" in told.data) == bool(note)
    sampled = named.sampled(0.1)
    np.savez("K.npz", K=np.eye(2), dt=0.1)
    np.testing.assert_array_equal(hfa.read_critic("K.npz", sampled).K, np.eye(2))
