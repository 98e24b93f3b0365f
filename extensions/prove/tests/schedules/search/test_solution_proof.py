"""Proofs of exact solutions, of delta_min from both sides, and of the distances of critics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from flint import arb
from known_models import game_at
from proof_cases import ORIGIN, content, family, forge, proved, scalar_game
from reference_riccati import reference_solution

from controller import basis, minimum_delta
from controller.critic.critic import from_gain, from_parts
from controller.critic.network.critic import from_network
from controller.riccati.smallest_delta import DeltaMin
from hfa import BadInputError, Game, NoSolutionError, prove_critic, prove_solution, solve
from hfa.main import main
from hfa_prove import check_certificate
from hfa_prove.check.game import solution_on
from hfa_prove.enclosure.balls import matrix, norm
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.report import checked_report
from hfa_prove.search.game import ExactGame, prove_delta_min, weights_of
from hfa_prove.statements.game import GameStatement

ONE = np.eye(1)


@pytest.mark.parametrize("dynamics", ["published", pytest.param("newton", marks=pytest.mark.slow)])
def test_the_solution_of_paper_s_game_is_proved(dynamics: str) -> None:
    """The solution of the paper's game is proved, and delta_min is bracketed."""
    proof = prove_solution(game_at(15.0, dynamics), family(dynamics), 15.0)
    assert proof.proved
    assert ("A - S P is Hurwitz", "proved") in proof.report().parts[0].rows
    assert proof.data["relative_radius"] < 1e-12
    assert proof.data["unstable_modes"] == 2
    above = proof.data["delta_min_above"]
    most = proof.data["delta_min_at_most"]
    assert most - above <= 1e-6 * most
    found = minimum_delta(game_at(15.0, dynamics))
    assert above < found.value * (1 + 1e-6)
    assert most > found.refused * (1 - 1e-6)


def test_the_enclosure_contains_the_reference() -> None:
    """The enclosure of P is narrower than 1e-25 and agrees with the solution in 60 digits."""
    game = game_at(15.0)
    P = ExactGame.of(game).solution()[1].P.range()
    away = norm((P - matrix(reference_solution(game).P)).entries()) / norm(P.entries())
    assert away < 1e-15  # the reference is rounded to doubles
    assert max(float(entry.rad()) for entry in P.entries()) < 1e-25


def test_open_stability_of_a_solution_is_null(monkeypatch: pytest.MonkeyPatch) -> None:
    """If no line is found for A - B K, its stability is open (null), not refuted (false)."""
    # The planted fault: a search that finds no line.
    monkeypatch.setattr(
        "hfa_prove.search.game.bounds_of_modes",
        lambda A: ((0, A.parts[0].nrows()), []),
    )
    proof = prove_solution(scalar_game(2.0))
    assert not proof.proved
    assert proof.data["closed_loop_hurwitz"] is None
    assert ("A - B K is Hurwitz", "open") in proof.report().parts[0].rows


@pytest.mark.parametrize("delta", [2.0, np.inf])
def test_the_data_of_a_scalar_game_are_its_closed_form(delta: float) -> None:
    """p² s + 2 p - 1 = 0 with s = 1 - 1/δ², and delta_min = 1/sqrt(2), for a = -1."""
    said: list[str] = []
    proof = prove_solution(scalar_game(delta), progress=lambda done, total, what: said.append(what))
    s = 1.0 - 1.0 / delta**2
    data = proof.data
    assert data["P"] == pytest.approx((np.sqrt(1.0 + s) - 1.0) / s, rel=1e-12)
    assert 0.0 < data["relative_radius"] < 1e-12
    assert data["delta_min_above"] < np.sqrt(0.5) <= data["delta_min_at_most"]
    assert (data["delta"], data["unstable_modes"]) == (2.0 if delta == 2.0 else None, 0)
    for name in ("proved", "positive_definite", "worst_case_hurwitz", "closed_loop_hurwitz"):
        assert data[name] is True
    assert data["unstable_modes_between"] == [0, 0]
    assert isinstance(proof.statement, GameStatement)
    assert proof.statement.gain_of_value
    assert list(dict.fromkeys(said))[:5] == [
        "solving in doubles", "enclosing the linear model", "enclosing the solution",
        "bounding delta_min from above", "bounding delta_min from below",
    ]  # fmt: skip
    with pytest.raises(BadInputError, match="game"):
        prove_solution("a game")  # type: ignore[arg-type]


def test_the_exact_critic_has_no_distance() -> None:
    """With a = 0 and b = q = r = 1, P = K = 1 exactly: 0 is within the bounds of each distance."""
    game = Game(A=0.0 * ONE, B=ONE, E=ONE, Q=ONE, R=ONE, delta=np.inf)
    for critic in (from_parts(game, {"P": ONE, "K": ONE}), from_parts(game, {"P": ONE})):
        proof = prove_critic(game, critic)
        for bounds in proof.data["distances"].values():
            assert bounds["at_least"] == 0.0 <= bounds["at_most"] < 1e-25
        assert isinstance(proof.statement, GameStatement)
        assert proof.statement.gain_of_value
    assert set(proof.data["distances"]) == {"P", "K"}
    for wrong in (("a game", critic), (game, "a critic")):
        with pytest.raises(BadInputError):
            prove_critic(*wrong)  # type: ignore[arg-type]


def test_a_root_that_does_not_stabilize_is_refused() -> None:
    """The root of p² - 2 p - 1 = 0 that does not stabilize is refused as the solution of a game.

    For a = 1 the roots are 1 ± sqrt(2). The larger root is positive and stabilizes, and is proved.
    """
    exact = ExactGame.of(Game(A=ONE, B=ONE, E=ONE, Q=ONE, R=ONE, delta=np.inf))
    box, right = exact.solution()
    assert right.P.range()[0, 0].contains(1 + matrix(2 * ONE)[0, 0].sqrt())
    other = replace(box, P=TaylorModel(matrix([[1.0 - np.sqrt(2.0)]])), reach=arb(1e-10))
    for lowest in (-1, 1):
        with pytest.raises(Rejected, match="not proved positive definite"):
            solution_on(exact.weights, *exact.doubles, other, lowest)


@pytest.mark.parametrize("found", [4e-7, 4e-4])
def test_delta_min_of_a_scalar_game_is_bracketed(found: float) -> None:
    """delta_min = 1/sqrt(2) of a scalar game is bracketed.

    p² s + 2 p - 1 = 0 with s = 1 - 1/δ² has real roots for 1 + s >= 0.
    """
    exact = 1.0 / np.sqrt(2.0)
    nearly = DeltaMin(exact * (1 + 3 * found), exact * (1 - found))
    bracket = prove_delta_min(ExactGame.of(scalar_game(2.0)), nearly)
    assert bracket is not None
    assert bracket.refused < exact <= bracket.value
    assert bracket.value - bracket.refused <= 1e-6 * bracket.value


@pytest.mark.parametrize("share", [1e-5, 0.1])
def test_solutions_exist_only_above_delta_min(share: float) -> None:
    """The existence of a solution is proved above delta_min and refuted below."""
    game = ExactGame.of(game_at(15.0))
    smallest = minimum_delta(game_at(15.0)).value
    above, below = (game.with_delta(smallest * (1 + sign * share)) for sign in (1, -1))
    assert (above.has_value(), below.has_value()) == (True, False)
    assert (above.why_no_value() is None, below.why_no_value() is None) == (True, False)


@pytest.mark.parametrize(
    "A", [[[0.0, 1.0], [0.0, 0.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]
)
def test_a_plant_with_integrators_is_proved(A: list[list[float]], tmp_path: Path) -> None:
    """A double integrator and a cart are proved.

    The eigenvalues of A on the axis are not counted, but their number is bounded.
    """
    B = np.zeros((len(A), 1))
    B[-1] = 1.0
    game = Game(A=A, B=B, E=B, Q=np.eye(len(A)), R=[[1.0]], delta=5.0)
    proof = prove_solution(game)
    assert proof.proved
    assert proof.data["unstable_modes"] is None
    assert proof.data["unstable_modes_between"] == [0, 2]
    proof.write(tmp_path / "integrators.json", ORIGIN)
    verified = checked_report(check_certificate(tmp_path / "integrators.json"))
    assert verified.data["proved"]
    assert "A has 0 to 2 unstable modes" in verified.text()


def test_q_that_is_not_quite_semidefinite_is_refused() -> None:
    """A Q with a slightly negative eigenvalue is refused, and an R with one."""
    game = Game(A=-np.eye(2), B=np.eye(2), E=np.eye(2), Q=np.eye(2), R=np.eye(2), delta=5.0)
    slightly = replace(game, Q=np.array([[1.0, 1.0], [1.0, np.nextafter(1.0, 0.0)]]))
    with pytest.raises(NoSolutionError, match="Q has a negative eigenvalue in exact arithmetic"):
        prove_solution(slightly)
    for below in (0.0, 1.0):  # negative, and 0
        almost = replace(game)
        R = np.array([[1.0, 1.0], [1.0, np.nextafter(1.0, below)]])
        object.__setattr__(almost, "R", R)  # that its eigenvalues in doubles do not refuse
        with pytest.raises(NoSolutionError, match="R is not positive definite in exact"):
            weights_of(almost)


@pytest.mark.parametrize("size", [1e-12, 1e-3])
def test_the_distance_of_scaled_critic_is_proved(size: float) -> None:
    """The proved distance of a scaled critic from the exact solution equals the relative change."""
    game = game_at(15.0)
    functions = basis("quadratic", 6)
    exact = solve(game)
    right = {"W": functions.weights(exact.P), "P": exact.P, "K": exact.K}
    critic = from_parts(game, {name: array * (1 + size) for name, array in right.items()})
    proof = prove_critic(game, critic, family(), 15.0)
    assert set(proof.data["distances"]) == {"W", "P", "K"}
    for found in proof.data["distances"].values():
        assert found["at_least"] <= found["at_most"]
        np.testing.assert_allclose([*found.values()], size, rtol=1e-2 if size < 1e-11 else 1e-5)
    assert proof.data["closed_loop_hurwitz"]


def test_games_without_solution_and_networks_are_refused() -> None:
    """A game below delta_min has no proof, and a critic that is a network is refused."""
    with pytest.raises(NoSolutionError, match="delta_min"):
        prove_solution(game_at(15.0).with_delta(50.0))
    square = ca.Function("square", [x := ca.SX.sym("x", 6)], [x.T @ x])
    with pytest.raises(BadInputError, match="the critic is a network"):
        prove_critic(game_at(15.0), from_network(game_at(15.0), square))


def test_a_plant_below_delta_min_has_a_certificate(tmp_path: Path) -> None:
    """delta_min is bracketed from below by an eigenvalue of H on the imaginary axis.

    A bracket below delta_min is refused.
    """
    own = content(proved("scalar"))
    assert "frequencies" in own["witness"]
    data = checked_report(check_certificate(forge(tmp_path / "scalar.json", own))).data
    assert data["delta_min_above"] < np.sqrt(0.5) <= data["delta_min_at_most"]
    own["statement"]["delta_min"] = [0.5, data["delta_min_above"]]
    with pytest.raises(Rejected):
        check_certificate(forge(tmp_path / "scalar.json", own))


def test_a_destabilizing_gain_is_certified_as_unstable(
    tmp_path: Path,
) -> None:
    """A gain that does not stabilize is certified as unstable.

    Whether a gain with a pole on the axis stabilizes is left open.
    """
    proof = prove_critic(game_at(15.0), from_gain(game_at(15.0), np.zeros((5, 6))))
    assert proof.data["closed_loop_hurwitz"] is False
    assert (
        proof.data["distances"]["K"]["at_least"] <= 1.0 <= proof.data["distances"]["K"]["at_most"]
    )
    proof.write(tmp_path / "critic.json", ORIGIN)
    checked = checked_report(check_certificate(tmp_path / "critic.json"))
    assert (checked.data["closed_loop_hurwitz"], checked.data["proved"]) == (False, False)
    assert checked.title.startswith("Verified, refuted, the gain does not stabilize")
    assert proof.report().title.startswith("Refuted: the gain of the critic does not")
    game = Game(A=ONE, B=ONE, E=ONE, Q=ONE, R=ONE, delta=np.inf)
    proof = prove_critic(game, from_gain(game, ONE))
    assert proof.data["closed_loop_hurwitz"] is None
    proof.write(tmp_path / "critic.json", ORIGIN)
    checked = checked_report(check_certificate(tmp_path / "critic.json"))
    assert (checked.data["closed_loop_hurwitz"], checked.data["proved"]) == (None, False)
    assert checked.title.startswith("Verified, but whether the gain stabilizes is open")
    assert "open: whether A - B K with the critic's K is Hurwitz" in checked.text()
    assert main(["prove", "--check", str(tmp_path / "critic.json")]) == 1


def test_a_game_whose_disturbance_costs_nothing_has_no_bracket() -> None:
    """With delta_min = 0 there is nothing to bracket; the solution is still proved."""
    game = Game([[1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 2.0)
    assert minimum_delta(game).value == 0.0
    assert prove_delta_min(ExactGame.of(game), minimum_delta(game)) is None
    proof = prove_solution(game)
    assert proof.data["delta_min_above"] is None
    assert proof.data["closed_loop_hurwitz"] is True
