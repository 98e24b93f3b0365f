"""Tracking of a reference: late errors, costs, and trims at the commands."""

import math
from dataclasses import replace

import numpy as np
import pytest
from game_samples import game_models
from project import ROOT
from scipy.optimize import brentq

import hfa
from hfa import track
from hfa_aircraft.waveform import channel
from hfa_flight import Waveform

COMMAND = {"speed": "7+0.01t+2sin(0.5t)", "alpha": 0.1, "dihedral": 0.5}


def tracking(dihedral_deg, command=COMMAND):
    """The paper's game at a dihedral angle, tracking a command."""
    linear = hfa.paper.level_model(hfa.aircraft(), math.radians(dihedral_deg))
    return track(linear, hfa.solve(hfa.paper.published_game(linear)), command)


@pytest.mark.parametrize("dihedral_deg", [5.0, 15.0])
def test_the_command_of_the_paper_is_no_trim(dihedral_deg):
    """The commanded alpha and dihedral angle need a centre elevator far beyond its limits.

    The needed elevator is that of a trim with limits of ±9 rad. The dihedral angle alone is
    reachable. The first line of the report names the elevator.
    """
    start = hfa.paper.level_flight(math.radians(dihedral_deg)).imposed
    far = dict.fromkeys(("elevator_center", "elevator_outer", "aileron_outer"), (-9.0, 9.0))
    commanded = hfa.paper.level_flight(
        start["dihedral"] + 0.5,
        alpha=start["alpha"] + 0.1,
        limits={**far, "alpha": (-9.0, 9.0), "throttle": (0.0, 1e4)},
    )
    needed = hfa.trim(hfa.aircraft(), commanded)["elevator_center"]
    needed_deg = math.degrees(needed)
    assert needed_deg < -70.0
    found = tracking(dihedral_deg)
    assert not found.reachable
    together = {frozenset(each.command): each for each in found.trims}
    constant = together[frozenset({"alpha", "dihedral"})]
    assert constant.needed["elevator_center"] == pytest.approx(needed)
    assert math.degrees(constant.beyond["elevator_center"]) == pytest.approx(-30.0)
    assert together[frozenset({"dihedral"})].is_reachable
    title = str(found.report()).splitlines()[0]
    assert f"elevator_center needs {needed_deg:.1f}" in title


def test_a_commanded_pitch_is_a_trim_of_this_pitch():
    """The needed values are those of the climb with this pitch, which SciPy finds over gamma.

    A pitch 0.5 rad above that of the trim is not reachable.
    """
    model = hfa.load_model(f"{ROOT}/examples/navion.py:NAVION")
    point = hfa.trim(model)
    linear = hfa.linearize(model, point)
    solution = hfa.solve(hfa.game(linear, Q=np.ones(8), R=np.ones(4)))
    pitch = point["pitch"] + 0.03
    gamma = brentq(lambda gamma: hfa.trim(model, gamma=gamma)["pitch"] - pitch, 0.0, 0.1)
    found = track(linear, solution, {"pitch": 0.03})
    assert found.reachable
    climb = hfa.trim(model, gamma=gamma)
    for name, value in found.trims[0].needed.items():
        assert value == pytest.approx(climb[name], rel=1e-6, abs=1e-9)
    assert not track(linear, solution, {"pitch": 0.5}).reachable


@pytest.mark.parametrize("text", ["0.1sin(3.14159t)", "2+0.3t-sin(7t)+cos(0.001t)", "cos(0t)"])
def test_means_are_those_of_the_signal_whatever_its_frequency(text):
    """Mean squares over 2,000 s are those of a quadrature in 8,000 parts; cos(0 t) is a constant."""
    wave, ends = channel(text), np.linspace(0.0, 2000.0, 8001)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    times = ends[:-1, None] + 0.125 * (nodes + 1.0)
    squares = wave.sampled(times.ravel()).reshape(times.shape) ** 2
    assert wave.moments(2000.0).item() == pytest.approx((squares @ weights).mean() / 2, rel=1e-11)
    assert wave.oscillates.any() == ("sin" in text)


@pytest.mark.parametrize(
    ("command", "options", "says"),
    [
        ({"x1": 1.0}, {"K": [[-1.0]]}, "A - B K has abscissa"),
        ({"x1": 1.0}, {"duration": 0.0}, "duration"),
        ({"height": 1.0}, {}, "unknown state 'height'"),
        ({"x1": np.sin}, {}, "is no term of a signal"),
    ],
)
def test_wrong_arguments_are_refused(command, options, says):
    linear = hfa.LinearModel.of(np.array([[-0.5]]), np.array([[1.0]]))
    with pytest.raises(hfa.BadInputError, match=says):
        track(linear, hfa.solve(hfa.game(linear, Q=[1.0], R=[1.0])), command, **options)


@pytest.mark.parametrize("cross", [0.0, 0.1])
def test_feedforward_satisfies_its_differential_equation(cross):
    """-s' = (A - S P)'s + P r and u_d = -R⁻¹B's, of a constant, a ramp and sinusoids."""
    game = game_models()["published-5"]
    N = cross * np.random.default_rng(3).standard_normal((6, 5))
    game = replace(game, Q=game.Q + np.eye(6), R=game.R + np.eye(5), N=N)
    P = hfa.solve(game).P
    command = {"x1": "7+0.01t+2sin(0.5t)", "x2": "0.1+0.03cos(1.3t)", "x3": "0.002t+0.02sin(1.3t)"}
    exact = track(hfa.LinearModel.of(game.A, game.B), hfa.solve(game), command).exact
    s, reference = exact.costate, exact.reference
    plain = game.without_cross_weights
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / 12e-3  # of central differences
    for t in (0.0, 3.0, 17.0):
        around = t + 1e-3 * np.array([-2.0, -1.0, 1.0, 2.0])
        r = game.A @ reference.at(t) - weights @ np.array([reference.at(each) for each in around])
        rate = weights @ np.array([s.at(each) for each in around])
        off = rate + (plain.A - plain.S @ P).T @ s.at(t) + P @ r
        assert np.abs(off).max() < 1e-9 * np.abs(P @ r).max()
        assert exact.inputs.at(t) == pytest.approx(-np.linalg.solve(game.R, game.B.T @ s.at(t)))


def test_late_errors_solve_the_loop_and_give_the_means():
    """z' = (A - B K) z + B u_d + A x_d - x_d', and the means are those of z and u over a period.

    The optimal policy has the least cost per second, 2 s'r - s'S s on average, with the costate s
    and r = A x_d - x_d'. Without feedforward, and with 0.9 K, the cost is higher. The report has the
    rms values of the command.
    """
    rng = np.random.default_rng(4)
    A, B = rng.standard_normal((3, 3)), rng.standard_normal((3, 2))
    N = 0.2 * rng.standard_normal((3, 2))
    R = np.diag([2.0, 1.0])
    solution = hfa.lqr(A, B, 2.0 * np.eye(3), R, N)
    period = 2.0 * math.pi / 0.7
    command = {"x1": "1+0.2sin(0.7t)", "x3": 0.5}
    linear = hfa.LinearModel.of(A, B)
    found = track(linear, solution, command, duration=period)
    t = np.linspace(0.0, period, 2001)[:, None]
    # x_d and A x_d - x_d' of the command, (times, 3)
    x1, constant = np.eye(3)[0], np.array([1.0, 0.0, 0.5])
    x_d = constant + 0.2 * np.sin(0.7 * t) * x1
    forcing = x_d @ A.T - 0.2 * 0.7 * np.cos(0.7 * t) * x1
    no_inputs = Waveform(np.zeros(2), np.zeros(2))
    for inputs, rms, cost in (
        (found.inputs, found.rms_errors, found.cost_per_second),
        (
            no_inputs,
            found.rms_errors_without_feedforward,
            found.cost_per_second_without_feedforward,
        ),
    ):
        z = found.late_error(inputs).sampled(t[:, 0])
        u = inputs.sampled(t[:, 0]) - z @ found.K.T
        rate = z @ A.T + u @ B.T + forcing
        np.testing.assert_allclose(np.gradient(z, t[:, 0], axis=0)[1:-1], rate[1:-1], atol=1e-4)
        assert rms == pytest.approx(np.sqrt((z[:-1] ** 2).mean(axis=0)), rel=1e-9)
        paid = 2.0 * (z * z).sum(axis=1) + (u @ R * u).sum(axis=1) + 2.0 * (z @ N * u).sum(axis=1)
        assert cost == pytest.approx(paid[:-1].mean(), rel=1e-9)
    # the least cost
    s, r = (each.sampled(t[:-1, 0]) for each in (found.exact.costate, found.exact.forcing))
    S = found.game.S_control
    least = (2.0 * (s * r).sum(axis=1) - (s @ S * s).sum(axis=1)).mean()
    assert found.cost_per_second == pytest.approx(least, rel=1e-8)
    assert found.cost_per_second_without_feedforward > 1.01 * least
    # the report
    (table, *_) = (part for part in found.report().parts if not isinstance(part, str))
    command_rms = np.sqrt((x_d[:-1] ** 2).mean(axis=0))
    assert [float(cells[2]) for cells in table.rows] == pytest.approx(command_rms, rel=5e-3)
    # another gain
    of_other_gain = track(linear, solution, command, K=0.9 * solution.K, duration=period)
    assert of_other_gain.cost_per_second > least
