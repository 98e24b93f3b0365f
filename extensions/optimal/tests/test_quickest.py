"""Quickest flights compared with closed forms and another integrator, and planted errors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hfa
from hfa.main import main

EXAMPLES = Path(__file__).parents[3] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"


def cart() -> hfa.Model:
    """Return a double integrator with bounded input."""
    return hfa.Model(
        "cart",
        {"position": hfa.Signal("m", min=-20.0, max=20.0), "velocity": hfa.Signal("m/s")},
        {"force": hfa.Signal("N", min=-2.0, max=2.0)},
        lambda x, u, p, w: ({"position": x.velocity, "velocity": u.force}, {}),
        trim={"position": 0.0},
    )


@pytest.fixture(scope="module")
def cart_flight() -> Any:
    model = cart()
    begin = hfa.trim(model, hold={"position": 8.0})
    return hfa.optimize(model, hfa.trim(model), begin, minimize="time")


def test_the_quickest_double_integrator_equals_closed_form(cart_flight: Any) -> None:
    """The quickest time of a double integrator over a distance d is at least 2 sqrt(d / u_max).

    The time found exceeds this least time by at most 0.5 %.
    """
    least = 2.0 * np.sqrt(8.0 / 2.0)
    assert least <= cart_flight.seconds <= 1.005 * least
    assert cart_flight.saturated == ["force"]
    assert cart_flight.spread < 0.005


def test_the_quickest_time_with_speed_limit_is_exact() -> None:
    """With a speed limit v, the quickest time over the distance d is d / v + v / u, within 0.5 %."""
    model = cart()
    point = hfa.trim(model)
    best = hfa.optimize(
        model, point, {"position": 8.0}, limits={"velocity": (-2.0, 2.0)}, minimize="time"
    )
    assert best.seconds == pytest.approx(8.0 / 2.0 + 2.0 / 2.0, rel=5e-3)
    assert np.abs(best.states[:, 1]).max() <= 2.0


def quickest_of_comb(waves: float) -> Any:
    """Return the quickest flight of a cart whose force depends on the position in waves."""
    smooth = cart()

    def rates(x: Any, u: Any, p: Any, w: Any) -> Any:
        push = u.force * (1.0 + 0.98 * ca.sin(waves * x.position))
        return {"position": x.velocity, "velocity": push}, {}

    model = hfa.Model("comb", smooth.states, smooth.inputs, rates, trim={"position": 0.0})
    return hfa.optimize(model, hfa.trim(model), {"position": 8.0}, minimize="time")


def test_meshes_are_refined_until_their_times_agree() -> None:
    """The times on two meshes differ by less than 0.5 %, where those on the first two do not."""
    best = quickest_of_comb(14.0)
    assert best.reason is None
    assert best.spread < 0.005


def test_without_a_proposal_the_time_is_when_a_simulated_flight_arrives_to_stay() -> None:
    """Where no two meshes agree: the first time after which no state of the LQR leaves its box."""
    best = quickest_of_comb(26.0)
    assert best.reason.startswith("two meshes differ by")
    assert (best.source, best.spread) == ("linear optimum, saturated", None)
    assert best.report().title.startswith(f"Quickest flight: at most {best.seconds:.4g} s")
    boxes = [best.box[name] for name in best.model.states]
    inside = (np.abs(np.asarray(best.states)) <= boxes).all(axis=1)
    after = np.asarray(best.time) >= best.seconds
    assert inside[after].all()
    assert not inside[~after][-1]


def assert_scipy_arrives(flight: Any, target: Any) -> None:
    """Assert that SciPy's simulation with the inputs of a flight ends in the box about the target."""

    def rate(t: float, x: np.ndarray) -> list[float]:
        u = [np.interp(t, flight.time, column) for column in flight.inputs.T]
        return list(flight.model.rates_at(x, u).values())

    rows = solve_ivp(rate, (0.0, flight.seconds), flight.states[0], rtol=1e-8, max_step=0.01)
    end = dict(zip(flight.model.states, rows.y[:, -1], strict=True))
    for name, width in flight.box.items():
        assert abs(end[name] - target[name]) <= width


def test_scipys_simulation_arrives_in_the_target_box(cart_flight: Any) -> None:
    """With the inputs of the quickest flight, SciPy's simulation ends in the same arrival box."""
    assert_scipy_arrives(cart_flight, hfa.trim(cart_flight.model))


@pytest.mark.parametrize("minimize", ["time", "cost"])
def test_optimize_finds_a_flight_between_trims(
    minimize: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """`hfa optimize --to` finds a flight between two trims.

    The quickest one ends within the target box. No compared policy costs less than the cheapest one.
    """
    words = ["optimize", "--aircraft", PENDULUM, "--hold", "angle=5", "--to", "angle=8"]
    assert main([*words, "--minimize", minimize, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["start"]["angle"] == pytest.approx(-np.radians(3.0), rel=1e-6)
    if minimize == "time":
        assert 0.05 < data["seconds"] < 1.5
        for name, width in data["box"].items():
            assert abs(data["arrival"][name]) <= width
    else:
        assert data["policies"][0]["over_best"] >= 0.999


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "seconds"), [(5.0, 1.571), (10.0, 0.861)])
def test_the_hfa_changes_its_dihedral_to_15_degrees(begin: float, seconds: float) -> None:
    """SciPy's simulation of the HFA arrives at a dihedral of 15 deg.

    The flight takes at most 1 % longer than one found before. The times on two meshes differ by
    less than 0.5 %.
    """
    model = hfa.aircraft()
    end, start = (
        hfa.trim(model, hold={"dihedral": np.radians(degrees)}) for degrees in (15.0, begin)
    )
    game = hfa.paper.published_game(hfa.linearize(model, end))
    best = hfa.optimize(model, end, start, game.Q, game.R, minimize="time")
    assert_scipy_arrives(best, end)
    assert best.seconds <= 1.01 * seconds
    assert best.spread < 0.005
    assert best.reserve < 0.01
