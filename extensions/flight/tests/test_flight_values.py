"""`hfa.fly` and its result in scripts and notebooks."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa_flight.initial_box import drawn_starts
from hfa_flight.problem import flight_problem
from hfa_flight.scenario import Scenario
from hfa_support.errors import BadInputError

#: v' = -v + u, x' = v: the step response of v is 1 - exp(-t).
CART = hfa.Model(
    "cart",
    {"position": hfa.Signal("ft"), "speed": hfa.Signal("ft/s")},
    {"force": hfa.Signal("lbf", min=-100.0, max=100.0)},
    lambda x, u, p, w: ({"position": x.speed, "speed": u.force - x.speed}, {"twice": 2 * x.speed}),
    outputs={"twice": hfa.Signal("ft/s")},
    trim={"position": 0.0, "speed": 0.0},
    steady=("speed",),
)
POINT = hfa.trim(CART)


def test_steps_of_an_input_give_the_step_response() -> None:
    """A step of an input gives the analytical step response, and outputs follow the states."""
    flight = hfa.fly(CART, POINT, {"force": [(0.0, 1.0)]}, 2.0)
    np.testing.assert_allclose(flight["speed"], 1.0 - np.exp(-flight.time), atol=1e-10)
    np.testing.assert_allclose(flight["twice"], 2.0 * flight["speed"], atol=1e-12)
    assert flight.time[-1] == pytest.approx(2.0)
    assert (flight["force"] == 1.0).all()
    late = flight["speed"][len(flight.time) // 2 :]
    assert flight.rms_error["speed"] == pytest.approx(np.sqrt(np.mean(late**2)), rel=1e-12)


@pytest.mark.parametrize(("lowest", "highest"), [(-1.0, 10.0), (-10.0, 1.0)])
def test_drawn_initial_conditions_are_within_the_nearer_limit(
    lowest: float, highest: float
) -> None:
    """The initial conditions reach 0.9 of the way to the nearer limit, in both directions."""
    speed = CART.states["speed"]._replace(min=lowest, max=highest)
    model = replace(CART, states={**CART.states, "speed": speed})
    problem = flight_problem(model, hfa.trim(model))
    starts = drawn_starts(problem, 200, 0, np.array([1.0, 5.0]))[:, 1]
    assert -0.9 <= starts.min() < -0.8
    assert 0.8 < starts.max() <= 0.9


@pytest.mark.parametrize(
    "kind", ["gain", "solution", "critic", "function", "mapping", "deployment"]
)
def test_every_kind_of_policy_gives_the_same_flight(kind: str) -> None:
    """All policies with the same K give the same flight.

    The tolerance is 0.005, because functions and deployments are called once a tick.
    """
    game = hfa.game(hfa.linearize(CART, POINT), Q=np.eye(2), R=np.eye(1))
    solution = hfa.solve(game)
    K = solution.K
    o = ca.SX.sym("o", 2)
    policies = {
        "gain": K,
        "solution": solution,
        "critic": hfa.from_gain(game, K),
        "function": lambda t, x: -K @ np.array(x),
        "mapping": lambda t, x: {"force": -(K @ np.array(x)).item()},
        "deployment": hfa.Deployment(
            policy={"file": ca.Function("policy", [o], [-ca.mtimes(ca.DM(K), o)])},
            observation={"position": {}, "speed": {}},
            action={"force": {"box": [-9, 9], "map": "trim + a"}},
            timing={"dt": 0.01},
        ),
    }
    flight = hfa.fly(CART, POINT, policies[kind], 3.0, initial={"position": 1.0})
    exact = hfa.fly(CART, POINT, K, 3.0, initial=[1.0, 0.0])
    every = 10 if kind == "deployment" else 1  # its tick is 10 ms
    np.testing.assert_allclose(flight.states, exact.states[::every], atol=5e-3)
    assert flight.predicted is not None
    np.testing.assert_allclose(flight.states, flight.predicted.states, atol=1e-12)


@pytest.mark.parametrize(
    ("policy", "said"),
    [
        (b"K", "give a gain K, a critic"),
        ("K", "the suffix '' is unknown"),
        (lambda t: 0.0, r"does not accept \(t, X\)"),
        (lambda t, x: {"thrust": 1.0}, "unknown input 'thrust'"),
        (lambda t, x: [np.nan], "give 1 finite numbers"),
        ({"force": [1.0, 2.0]}, "the steps of force"),
        ({"force": [(1.0, 2.0), (0.5, 0.0)]}, "give increasing times"),
        ([[1.0, 2.0, 3.0]], "give 1 x 2"),
    ],
)
def test_unusable_policies_are_refused(policy: object, said: str) -> None:
    """Objects that are not a policy of this aircraft are refused with the reason."""
    with pytest.raises(BadInputError, match=said):
        hfa.fly(CART, POINT, policy, 1.0)


def test_a_flight_is_exported_and_drawn() -> None:
    """A flight is converted to pandas, xarray, a picture and HTML.

    An unknown variable is refused.
    """
    from matplotlib import pyplot

    flight = hfa.fly(CART, POINT, {"force": [(0.0, 1.0)]}, 0.1)
    frame = flight.to_pandas()
    assert list(frame.columns) == ["position", "speed", "force"]
    assert frame.index.name == "time"
    np.testing.assert_array_equal(frame["speed"], flight["speed"])
    data = flight.to_xarray()
    assert data["speed"].attrs["units"] == "ft/s"
    np.testing.assert_allclose(data["speed"], data["speed_linear"], atol=1e-12)
    assert [axes.get_ylabel() for axes in flight.plot()][:2] == ["position, ft", "speed, ft/s"]
    pyplot.close()
    assert "data:image/png" in flight._repr_html_()
    assert repr(flight).startswith("PASS: ")
    with pytest.raises(BadInputError, match="unknown variable 'sped'"):
        flight["sped"]


@pytest.mark.parametrize("step", [0.01, 1.0, 2.5])
def test_a_flight_states_its_integration_error(step: float) -> None:
    """The step is halved until cost and largest speed are exact to about 0.1 %.

    From a speed of 1, the cart has the speed exp(-t) and, with the weight 1 of the speed, the cost
    0.5 (1 - exp(-20)). The cost is that of the trapezoidal rule at the stored steps.
    """
    weights = np.diag([0.0, 1.0]), np.eye(1)
    scenario = Scenario(10.0, step, step)
    flight = hfa.fly(CART, POINT, None, scenario=scenario, initial={"speed": 1.0}, weights=weights)
    error = flight.integration
    assert error.is_resolved
    assert (error.step < step) == (step >= 1.0)
    assert flight["position"][-1] == pytest.approx(1.0 - np.exp(-10.0), rel=2e-3)
    assert flight.as_data()["integration"]["step"] == error.step
    assert error.text() in str(flight.report())


def test_a_python_function_is_called_in_one_flight_alone() -> None:
    """The function is called once a tick, and no integration error is stated."""
    called: list[float] = []

    def push(t: float, X: object) -> dict[str, float]:
        called.append(t)
        return {"force": 1.0}

    flight = hfa.fly(CART, POINT, push, 0.5, predict=False)
    assert flight.integration is None
    assert called == sorted(set(called))
    assert "integration" not in flight.as_data()
