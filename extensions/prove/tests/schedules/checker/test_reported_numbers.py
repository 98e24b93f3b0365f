"""The numbers of a report are those of the statement, recomputed here by formulas."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from as_proved import as_proved
from proof_cases import forge
from stored_certificates import pendulum, read, stored

import hfa
from hfa import BadInputError, NoSolutionError
from hfa_flight.problem import flight_problem
from hfa_prove.bound import lower_bound
from hfa_prove.report import checked_report
from hfa_prove.report_cost import checked_bound_report
from hfa_prove.report_region import checked_report as region_report
from hfa_prove.statements.region import RegionStatement
from hfa_prove.words import at_least, at_most


def W_at(piece: dict[str, Any], z: np.ndarray) -> np.ndarray:
    """Return W (N,) at deviations z (N, n), from the stored entries of a piece."""
    y = z @ np.array(piece["M"]).T
    return sum(value * np.prod(y ** np.array(powers), axis=1) for value, powers in piece["W"])


Z = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2))


@pytest.mark.parametrize(
    ("name", "prover"),
    [("region_boxes", "boxes"), ("region", "squares"), ("region_disturbed", "squares")],
)
def test_the_report_of_a_region_states_its_numbers(name: str, prover: str) -> None:
    """V, its level, the gain, the disturbances and the number of boxes or parts are reported.

    The extents of an ellipsoid {z'Pz <= rho} are sqrt(rho P⁻¹_ii), at most 0.2 % wider with boxes.
    """
    claim = stored(name)["statement"]
    statement, witness = read(stored(name))
    report = region_report(as_proved(statement, witness, sizes=(7, 5)))
    data = report.data
    V = sum(value * np.prod(Z ** np.array(powers), axis=1) for value, powers in data["terms"])
    assert pytest.approx(W_at(claim["piece"], Z), rel=1e-9) == V
    assert pytest.approx(np.einsum("bi,ij,bj->b", Z, data["P"], Z), rel=1e-9) == V
    assert (data["rho"], data["degree"]) == (claim["piece"]["c"], 2)
    assert data["disturbances"] == claim["loop"]["disturbances"]
    assert data["policy"]["K"] == claim["loop"]["policy"]["K"]
    assert (data.get("boxes"), data.get("parts")) == (
        (12, None) if prover == "boxes" else (None, 12)
    )
    half = np.sqrt(data["rho"] * np.diag(np.linalg.inv(data["P"])))
    assert list(data["extents"].values()) == pytest.approx(half, rel=2e-3)
    assert np.all(np.array(list(data["extents"].values())) >= half * (1.0 - 1e-12))
    assert ("invariant set" in report.title) == bool(claim["loop"]["disturbances"])
    text = report.text()
    assert ("Convergence is not claimed" in text) == bool(claim["loop"]["disturbances"])
    assert "12 boxes" in text if prover == "boxes" else "12 parts" in text


def test_the_extent_of_a_state_is_the_larger_end() -> None:
    """The extent of a state is its largest absolute deviation, whichever end it is."""
    statement, witness = read(stored("region_boxes"))
    ends = {"angle": (-2.0, 1.0), "rate": (-1.0, 3.0)}
    data = region_report(as_proved(replace(statement, extents=ends), witness)).data
    assert data["extents"] == {"angle": 2.0, "rate": 3.0}


def test_a_region_of_higher_degree_has_no_matrix() -> None:
    """V = z_1² + z_2⁴ has the degree 4 and no matrix P."""
    statement, witness = read(stored("region_boxes"))
    terms = ((1.0, (2, 0)), (1.0, (0, 4)))
    quartic = RegionStatement.of_terms(statement.loop, terms, 1.0, statement.extents)
    data = region_report(as_proved(quartic, witness)).data
    assert data["degree"] == 4
    assert "P" not in data
    assert data["terms"] == [[1.0, [2, 0]], [1.0, [0, 4]]]


def test_the_report_of_a_bound_states_each_piece() -> None:
    """Weights, levels, polynomials and numbers of boxes of all pieces are those of the statement.

    The bound is the largest of min(W, c) in |y_i| < 1 and c elsewhere, about the equilibrium.
    """
    claim = stored("cost")["statement"]
    statement, witness = read(stored("cost"))
    sizes = tuple(range(1, 9))
    data = checked_bound_report(as_proved(statement, witness, sizes), []).data
    assert np.array_equal(data["Q"], claim["Q"])
    assert np.array_equal(data["R"], claim["R"])
    assert data["equilibrium"] == claim["equilibrium"]
    expected = []
    for piece, shown, size in zip(claim["pieces"], data["pieces"], sizes, strict=True):
        assert (shown["c"], shown["boxes"]) == (piece["c"], size)
        assert np.array_equal(shown["M"], piece["M"])
        rows = [[c, p] for c, p in zip(shown["coefficients"], shown["powers"], strict=True)]
        assert rows == piece["W"]
        y = Z @ np.array(piece["M"]).T
        inside = np.all(np.abs(y) < 1.0, axis=1)
        W = np.minimum(W_at(piece, Z), piece["c"])
        expected.append(np.where(inside, W, piece["c"]))
    moved = {name: value + 0.25 for name, value in statement.equilibrium.items()}
    assert statement.bound(Z) == pytest.approx(np.max(expected, axis=0), rel=1e-9)
    assert replace(statement, equilibrium=moved).bound(Z + 0.25) == pytest.approx(
        statement.bound(Z)
    )
    assert statement.level == max(piece["c"] for piece in claim["pieces"])


def test_a_bound_is_read_for_the_flights_of_a_problem_alone(tmp_path: Path) -> None:
    """The bound of a certificate is returned if it is proved and about the flights of a problem.

    Other weights, fewer moving inputs and a forged W are refused.
    """
    content = copy.deepcopy(stored("cost"))
    for entries in (content["statement"]["pieces"], content["witness"]["boxes"]):
        del entries[:-1]
    path = forge(tmp_path / "cost.json", content)
    model = pendulum()
    point = hfa.trim(model)
    problem = flight_problem(model, point, [1.0, 1.0], [1.0])
    assert lower_bound(path, problem).level == content["statement"]["pieces"][0]["c"]
    for other in (
        flight_problem(model, point, [1.0, 2.0], [1.0]),
        flight_problem(model, point, [1.0, 1.0], [2.0]),
        replace(problem, linear=problem.linear.select(inputs=())),
    ):
        with pytest.raises(BadInputError):
            lower_bound(path, other)
    for term in content["statement"]["pieces"][0]["W"]:
        term[0] *= 4.0
    with pytest.raises(NoSolutionError):
        lower_bound(forge(tmp_path / "forged.json", content), problem)


@pytest.mark.parametrize("value", [0.123456789, -0.123456789, 987654.321, 3.0])
@pytest.mark.parametrize("digits", [2, 4, 6])
def test_bounds_are_printed_rounded_to_their_side(value: float, digits: int) -> None:
    """A printed lower bound is at most the value, and an upper bound at least, within a digit."""
    low, high = float(at_least(value, digits)), float(at_most(value, digits))
    assert low <= value <= high
    assert high - low <= 10.0 ** (1 - digits) * abs(value)


@pytest.mark.parametrize(
    ("loop", "hurwitz", "title"),
    [
        ((0, 0), True, "Verified, proved"),
        ((0, 2), None, "Verified, but whether the gain stabilizes is open"),
        ((1, 2), False, "Verified, refuted, the gain does not stabilize"),
    ],
)
def test_the_report_of_a_game_states_its_numbers(
    loop: tuple[int, int], hurwitz: bool | None, title: str
) -> None:
    """The bracket of delta_min, the distances, the weights and the modes are the statement's.

    The claim is proved if the loop has no unstable mode, and refuted if it has one.
    """
    claim = stored("solution")["statement"]
    statement, _ = read(stored("solution"))
    report = checked_report(as_proved(replace(statement, loop=loop), sizes=(3,)))
    data = report.data
    assert (data["proved"], data["closed_loop_hurwitz"]) == (hurwitz is True, hurwitz)
    assert report.title.startswith(f"{title}:")
    assert [data["delta_min_above"], data["delta_min_at_most"]] == claim["delta_min"]
    assert data["unstable_modes_between"] == claim["modes"]
    assert {name: list(ends) for name, ends in data["distances"].items()} == claim["distances"]
    assert data["game"] == claim["weights"]
    assert (data["boxes"], data["kind"]) == (3, "game")
