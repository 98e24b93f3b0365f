"""What refutes a proposed flight: planted errors in the candidate and in the search."""

import casadi as ca
import numpy as np
import pytest
from carts import best_of_cart
from cli import answer, hfa as command
from known_models import game_at, model_at
from project import ROOT

import hfa
from hfa_flight.plan.search import BestFlights, refutation


@pytest.fixture(scope="module")
def best():
    return best_of_cart({"position": 5.0})


def test_the_simulation_confirms_or_refutes_a_candidate(best):
    """The flight of a candidate of the optimizer may cost as much as the candidate states, or less: it is
    confirmed, also if 5 % is added to the stated cost. With 5 % less, or with other inputs, it is refuted.
    """
    candidate = best.found.candidate
    flights = BestFlights(best.problem).flights
    flown = flights.follow(candidate, 1.25 * best.seconds)  # with the linear policy at the end
    assert refutation(flown, candidate) == ""
    assert "off the proposed" in refutation(flown, candidate._replace(cost=0.95 * candidate.cost))
    assert refutation(flown, candidate._replace(cost=1.05 * candidate.cost)) == ""
    wrong = candidate._replace(v=candidate.v + 0.2)
    assert refutation(flights.follow(wrong, 1.25 * best.seconds), wrong)


class Failing:
    """A solver that finds nothing."""

    def __init__(self, name, plugin, program, options):
        self.sizes = {"x": program["x"].numel(), "f": 1, "g": program["g"].numel()}

    def __call__(self, **given):
        return {name: ca.DM.nan(size) for name, size in self.sizes.items()}

    def stats(self):
        return {"return_status": "Infeasible_Problem_Detected"}


def test_the_saturated_lqr_is_the_last_resort(monkeypatch):
    """If IPOPT finds nothing (planted), the converging flight of the saturated LQR is reported, and
    the title says that the best flight costs at most as much.
    """
    monkeypatch.setattr(ca, "nlpsol", Failing)
    best = best_of_cart({"position": 5.0})
    linear = best.compared[0]
    assert best.source == linear.policy
    assert best.reason.startswith("IPOPT finds no flight within the limits")
    assert best.cost == linear.cost
    assert f"at most {best.cost:.6g}" in best.title().partition("\n")[0]


def test_a_policy_costs_what_it_costs_in_fly_and_may_be_the_best_flight(monkeypatch):
    """A policy that plans makes its first plan from the initial condition, here too. Where IPOPT finds
    nothing (planted) its flight is the best one; of a swing from 2.6 rad, which never ends, there is none.
    """
    monkeypatch.setattr(ca, "nlpsol", Failing)
    pendulum = hfa.load_model(f"{ROOT}/examples/pendulum.py:PENDULUM")
    point = hfa.trim(pendulum)
    policies = {"plans": hfa.predictive(pendulum, point, budget=np.inf)}
    best = hfa.optimize(pendulum, point, {"angle": 0.8}, policies=policies)
    weights = best.Q, best.R

    def flown(angle):
        start = {"angle": angle}
        return hfa.fly(pendulum, point, policies["plans"], 30.0, initial=start, weights=weights)

    assert best.policies[-1].cost == pytest.approx(flown(0.8).cost, rel=1e-6)
    assert best.cost == min(row.cost for row in (best.flown, *best.policies))
    assert best.source == "plans"
    assert best.reason
    assert not flown(2.6).returned


def test_initial_conditions_without_a_flight_count_in_the_share(folder, monkeypatch):
    """IPOPT finds nothing (planted: `Failing`), and the linear optimum of a cart exceeds its speed limit
    from some of 5 initial conditions. The command passes if the share of the others is at least that
    of --need.
    """
    monkeypatch.setattr(ca, "nlpsol", Failing)
    np.savez("cart.npz", A=[[0.0, 1.0], [0.0, 0.0]], B=[[0.0], [1.0]])
    words = ("optimize", "--aircraft", "cart.npz", "--starts", "5", "--limit", "x2=-0.3:0.3")
    found = answer(*words, code=1)["found"]
    assert 0 < found < 5
    for share, code in ((found / 5, 0), (found / 5 + 0.1, 1)):
        assert command(*words, "--need", f"share={share}").code == code


def test_initial_conditions_without_a_flight_within_the_limits_are_refused(monkeypatch):
    """If IPOPT finds nothing (planted) and the saturated LQR leaves the limits, the start is refused.

    The cart needs 18 m to stop, of which 5 m are left.
    """
    monkeypatch.setattr(ca, "nlpsol", Failing)
    with pytest.raises(hfa.NoSolutionError, match="finds no flight within the limits"):
        best_of_cart({"position": 15.0, "velocity": 6.0})


@pytest.mark.slow
def test_a_best_flight_is_near_the_cheapest_known_one():
    """From x(0) at 10 deg, direct shooting over inputs held for 2.5 ms found a flight of cost 4549.5. The
    one search of `optimize`, from one guess, finds at most 3.8 % more.
    """
    point, game = model_at(10.0).point, game_at(10.0)
    best = hfa.optimize(point.model, point, {"speed": 5.0, "alpha": 0.05}, game.Q, game.R)
    assert best.reason is None
    assert best.cost < 1.038 * 4549.5
