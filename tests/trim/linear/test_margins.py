"""Stability margins of one loop and of all loops together."""

import math
import warnings

import control
import numpy as np
import pytest
from game_samples import game_models

import hfa
from hfa import Game, NoSolutionError, solve


def test_margins_of_an_unstable_loop_are_refused(game):
    """The message names the unstable pole. There is no disk margin."""
    K = solve(game).K
    with pytest.raises(NoSolutionError, match="not stable"):
        hfa.margins(game, -K)
    assert solve(game).closed_loops.disk_margin(-K) is None


@pytest.mark.parametrize("slow", [2.0**-26, 2.0**-28])
def test_rounding_does_not_stabilize_a_loop(slow):
    """A loop with the poles 2^46 and -slow in skewed states is refused.

    The least eigenvalue of Y with F'Y + Y F = -1 is negative, but far below the rounding of Y.
    """
    to_states, to_modes = np.array([[5.0, 3.0], [3.0, 2.0]]), np.array([[2.0, -3.0], [-3.0, 5.0]])
    A, K = (to_states @ np.diag(rates) @ to_modes for rates in ([2.0**46, 0.0], [0.0, slow]))
    with pytest.raises(NoSolutionError, match="not stable"):
        hfa.margins(hfa.LinearModel.of(A, np.eye(2)), K)


@pytest.mark.parametrize("factor", [1.0, 3.0])
@pytest.mark.parametrize("name", sorted(game_models()))
def test_gain_and_phase_margins_equal_python_control(name, factor):
    """Gain, phase and delay margins and crossovers of each named loop, with the other loops closed,
    agree with python-control, and disk margins with its sensitivity on a grid.

    The gain in dB is the smaller of both gain margins.
    """
    game = game_models()[name]
    K = factor * solve(game).K
    if np.linalg.eigvals(game.A - game.B @ K).real.max() >= 0.0:
        pytest.skip("the scaled gain does not stabilize")
    names = tuple(f"input_{place}" for place in range(len(K)))
    found = hfa.margins(hfa.LinearModel.of(game.A, game.B, inputs=names), K)
    assert tuple(found) == names
    for i, margin in enumerate(found.values()):
        others = [j for j in range(game.B.shape[1]) if j != i]
        loop = control.ss(game.A - game.B[:, others] @ K[others], game.B[:, [i]], K[[i]], 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a loop without a crossover
            computed, angles, _, _, crossovers, _ = control.stability_margins(loop, returnall=True)
        gains = np.asarray(computed)
        phases = np.abs(np.asarray(angles))
        least = np.minimum(phases, 360 - phases)
        low = gains[(gains < 1.0) & (gains > 1e-12)]
        high = gains[gains > 1.0]
        assert margin.gain_low == pytest.approx(low.max(initial=0.0), rel=1e-6)
        assert margin.gain_high == pytest.approx(high.min(initial=math.inf), rel=1e-6)
        assert margin.phase == pytest.approx(least.min(initial=math.inf), rel=1e-6)
        delays = np.radians(np.mod(angles, 360.0)) / crossovers
        assert margin.delay == pytest.approx(delays.min(initial=math.inf), rel=1e-6)
        if least.size:
            assert margin.crossover == pytest.approx(crossovers[least.argmin()], rel=1e-6)
        sensitivity = 1.0 / (1.0 + loop(1j * FREQUENCIES))
        assert margin.disk == pytest.approx(1.0 / np.abs(sensitivity - 0.5).max(), rel=1e-3)
        farther = min(margin.gain_high, 1.0 / margin.gain_low if margin.gain_low else math.inf)
        assert margin.gain == pytest.approx(20.0 * math.log10(farther), rel=1e-12)


FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 2000)])


def test_the_disk_margin_agrees_with_python_control():
    """The margin is that of SLICOT's μ on a grid of frequencies within 1 %.

    The grid may miss the smallest margin, so that ours may be smaller, but not 0.1 % larger.
    """
    pytest.importorskip("slycot", reason="the package slycot is not installed")
    for seed in range(2):
        rng = np.random.default_rng(seed)
        A, B = rng.standard_normal((4, 4)), rng.standard_normal((4, 2))
        game = Game(A, B, E=np.eye(4), Q=np.eye(4), R=np.eye(2), delta=1e3)
        K = 2.0 * rng.uniform(0.5, 1.0, (2, 1)) * solve(game).K
        loop = control.ss(A, B, K, 0.0)
        grid = np.concatenate([[1e-6], np.geomspace(1e-2, 1e2, 400)])
        theirs = control.disk_margins(loop, grid)[0]
        ours = solve(game).closed_loops.disk_margin(K).disk
        assert ours == pytest.approx(theirs, rel=1e-2)
        assert ours < theirs * (1.0 + 1e-3)


def test_a_delay_turns_a_leading_loop_by_more_than_half_a_turn():
    """The loop g s² / (s + 1)³ leads at both crossovers: a delay turns it by π + phase there.

    Crossovers are the roots of g² ω⁴ = (1 + ω²)³, the phase is π - 3 atan ω.
    """
    gain = 2.62
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]]
    linear = hfa.LinearModel.of(A, [[0.0], [0.0], [1.0]])
    squares = np.roots([1.0, 3.0 - gain**2, 3.0, 1.0])
    crossovers = np.sqrt(squares[squares > 0.0])
    phases = np.pi - 3.0 * np.arctan(crossovers)
    assert phases.min() > 0.0
    found = hfa.margins(linear, [[0.0, 0.0, gain]])["u1"]
    assert found.delay == pytest.approx(((np.pi + phases) / crossovers).min(), rel=1e-6)


def test_a_gain_margin_may_be_half_a_percent():
    """The loop g / (s + 1)³ with g = 7.96 is unstable from g = 8 on, and stable for all smaller gains."""
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]]
    linear = hfa.LinearModel.of(A, [[0.0], [0.0], [1.0]])
    found = hfa.margins(linear, [[7.96, 0.0, 0.0]])["u1"]
    assert (found.gain_low, found.gain_high) == pytest.approx((0.0, 8.0 / 7.96))


def test_an_input_without_a_gain_tolerates_all_changes():
    """The loop gain of the second input is 0: any gain and phase are tolerated."""
    linear = hfa.LinearModel.of(np.diag([1.0, -2.0]), np.eye(2))
    first, second = hfa.margins(linear, [[2.0, 0.0], [0.0, 0.0]]).values()
    assert (first.gain_low, first.gain_high) == (0.5, math.inf)
    assert (second.gain_low, second.gain_high, second.phase) == (0.0, math.inf, math.inf)


def test_the_disk_margin_does_not_depend_on_the_units_of_the_inputs():
    """Inputs in units that differ by ten orders have the margins of like units."""
    A, B = np.diag([1.0, -1.0], 1) + np.diag([0.0, -1.0, 1.0]), np.array([[0, 1.0], [1, 0], [1, 2]])
    K = solve(Game(A, B, Q=np.eye(3), R=np.eye(2))).K
    found = []
    for units in (np.ones(2), np.array([1e-4, 1e6])):
        game = Game(A, B * units, Q=np.eye(3), R=np.diag(units**2))
        found.append(solve(game).closed_loops.disk_margin([[1.5], [0.8]] * K / units[:, None]))
    assert tuple(found[1]) == pytest.approx(tuple(found[0]), rel=1e-5)


@pytest.mark.parametrize(
    ("A", "B", "K", "dt"),
    [
        ([[1.875, 1.203125], [0.984375, 0.015625]], [1, -1], [14.93642865634764, 6.770291312541618],
         None),
        ([[0.421875, 0.2109375], [0.4375, -0.171875]], [0.875, -1.0],
         [0.5457275279839782, -0.3184215520515957], 0.1),
    ],
)  # fmt: skip
def test_a_loop_stable_within_rounding_has_no_margins(A, B, K, dt):
    """Margins of a loop that is proved stable, but is not stable in doubles, are refused by a message,
    and a verdict has no number for its disk margin.
    """
    game = Game(A, np.reshape(B, (2, 1)), Q=np.eye(2), R=[1.0], dt=dt)
    with pytest.raises(NoSolutionError, match="a mode is undamped up to rounding"):
        hfa.margins(game, K)
    assert "margin of all inputs, disk" in str(hfa.verify(game, hfa.from_gain(game, K)))


@pytest.mark.parametrize("seed", range(3))
def test_a_loop_in_samples_is_stable_between_its_margins_and_not_beyond(seed):
    """At each margin of a random loop of three states, two inputs and steps of .1 s, a pole of the loop
    whose input is changed by the gain, or turned by the phase, is on the unit circle; the others,
    and those 1 % closer, are inside.
    """
    rng = np.random.default_rng(seed)
    A, B = 0.6 * rng.standard_normal((3, 3)), rng.standard_normal((3, 2))
    game = Game(A, B, Q=np.eye(3), R=np.eye(2), dt=0.1)
    K = solve(game).K

    def radius(i, factor):
        change = np.eye(2, dtype=complex)
        change[i, i] = factor
        return np.abs(np.linalg.eigvals(A - B @ change @ K)).max()

    joint = solve(game).closed_loops.disk_margin(K)
    assert (joint.gain - 1.0) / (joint.gain + 1.0) == pytest.approx(joint.disk / 2.0)
    assert math.tan(math.radians(joint.phase) / 2.0) == pytest.approx(joint.disk / 2.0)
    for i, margin in enumerate(hfa.margins(game, K).values()):
        for gain, closer in ((margin.gain_low, 1.01), (margin.gain_high, 0.99)):
            if 0.0 < gain < math.inf:
                assert radius(i, gain) == pytest.approx(1.0, abs=1e-6)
                assert radius(i, gain * closer) < 1.0
        if math.isfinite(margin.phase):
            turned = [np.exp(1j * math.radians(sign * margin.phase)) for sign in (-1.0, 1.0)]
            assert max(radius(i, each) for each in turned) == pytest.approx(1.0, abs=1e-6)
            assert all(radius(i, each**0.99) < 1.0 for each in turned)
        within = (1.0 + 0.999 * margin.disk / 2) / (1.0 - 0.999 * margin.disk / 2)
        assert radius(i, within) < 1.0
        assert radius(i, 1.0 / within) < 1.0
