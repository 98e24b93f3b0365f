"""The search for the weights of `servo`: its file holds for what is shipped, and the trade-off of the document."""

from __future__ import annotations

import copy
import itertools
import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from project import ROOT
from servo_cases import A_Z

from controller.design.design_file import read_design
from hfa_model import Aircraft
from hfa_support.reporting.text import Table
from verification.synthesis import design_line
from verification.synthesis.design_evaluation import DesignEvaluation
from verification.synthesis.design_line import DesignLine, OnTheLine
from verification.synthesis.tuning import Evaluation, Tuning
from verification.synthesis.tuning_file import load_tuning

#: Of the weight of the integral of A_z, in the table of the document.
FACTORS = (0.1, 1.0, 4.0, 16.0)


@cache
def searched(dynamics: str, design: str = "servo") -> tuple[Tuning, DesignEvaluation]:
    tuning = load_tuning(str(ROOT / "docs" / "results" / f"{design}_search.toml"))
    return tuning, DesignEvaluation(Aircraft(dynamics=dynamics), tuning)


def evaluated(factor: float, dynamics: str = "published") -> Evaluation:
    """With so many times the weight of the integral of A_z."""
    tuning, evaluation = searched(dynamics)
    values = tuning.first_values()
    place = [variable.name for variable in tuning.variables].index("acceleration_integral")
    values[place] *= factor
    return evaluation.at(values)


def row(factor: float) -> str:
    """As docs/servo.md has it: errors of both outputs without and with a fault, turbulence, fastest surface."""
    found = evaluated(factor)
    calm, fault = found.errors[:2]
    figures = [np.degrees(calm["dihedral"]), np.degrees(fault["dihedral"]), calm[A_Z], fault[A_Z]]
    figures += [math.degrees(found.rms[0]["dihedral"]), found.rms[0]["speed"]]
    figures.append(math.degrees(max(found.rates)))
    return f"| {factor:g} | {' | '.join(f'{each:.2f}' for each in figures)} |"


@pytest.mark.parametrize(
    "design", ["servo", "servo_gusts_commands", pytest.param("servo_gusts", marks=pytest.mark.slow)]
)
def test_what_is_shipped_keeps_the_constraints_of_its_search(design: str) -> None:
    tuning, evaluation = searched("published", design)
    found = evaluation.at(tuning.first_values())
    assert found.abscissa <= tuning.abscissa
    assert max(found.rates) <= tuning.rate
    assert found.margin >= tuning.margin
    assert found.fastest <= tuning.fastest
    assert max(found.gusts, default=0.0) <= 1.0
    places = {(gust.dynamics, gust.peak, gust.length, round(math.degrees(gust.dihedral))) for gust in tuning.gusts}
    every = itertools.product(("published", "newton"), (38.0, -22.0), (340.0, 460.0), (7, 13))
    assert places == (set(every) if design == "servo_gusts" else set())


@pytest.mark.parametrize(
    "factor", [0.7, 1.0, *(pytest.param(each, marks=pytest.mark.slow) for each in (0.3, 0.5, 2, 4))]
)
def test_what_less_turbulence_with_order_2_costs(factor: float) -> None:
    """The weights of the inputs by a factor: flights at 11 deg, and the worst corner of all angles of the search."""
    tuning = replace(searched("published", "servo_gusts")[0], gusts=(), margin=0.0)
    entries = copy.deepcopy(dict(tuning.start))
    weights = entries["weights"]["inputs"]
    entries["weights"]["inputs"] = {name: factor * weight for name, weight in weights.items()}
    corners = DesignEvaluation(Aircraft(), replace(tuning, dynamics=("published", "newton"))).of(entries)
    flown = DesignEvaluation(Aircraft(), replace(tuning, angles=(math.radians(11.0),))).of(entries)
    missed = [each["dihedral"] for each in (*flown.rms[2:], *flown.errors[2:])]
    row = f"| {factor:g} | {' | '.join(f'{math.degrees(each):.3f}' for each in missed)} | {corners.abscissa:.4f} |"
    assert row in (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")


def test_the_search_from_simvfa_starts_from_its_weights() -> None:
    results = ROOT / "docs" / "results"
    start = read_design(str(results / "servo_from_simvfa_start.toml"))
    assert start["weights"] == read_design("simvfa-1")["weights"]
    search = (results / "servo_from_simvfa.toml").read_text(encoding="utf-8")
    assert 'design = "servo_from_simvfa_start.toml"' in search


@pytest.mark.slow
def test_what_the_search_from_simvfa_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The design that is stored, and beside it the one that is shipped, on the file of the search."""
    monkeypatch.chdir(ROOT / "docs" / "results")
    tuning = load_tuning("servo_from_simvfa.toml")
    evaluation = DesignEvaluation(Aircraft(), tuning)
    text = (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")
    assert f"cost {evaluation.at(tuning.first_values()).cost:.3g} at first" in text
    assert f"{tuning.evaluations} evaluations" in text
    for words, design in (("found", "servo_from_simvfa_found.toml"), ("`servo-gusts`", "servo-gusts")):
        found = evaluation.of(read_design(design))
        assert found.abscissa <= tuning.abscissa
        assert max(found.rates) <= tuning.rate
        assert found.margin >= tuning.margin
        assert found.fastest <= tuning.fastest
        assert max(found.gusts) < 1.0
        missed = [math.degrees(each["dihedral"]) for each in (*found.rms, *found.errors)]
        cells = [f"{found.cost:.3f}", *(f"{each:.3f}" for each in missed), f"{max(e[A_Z] for e in found.errors):.2f}"]
        row = f"| {words} | {' | '.join(cells)} | {max(found.gusts):.2f} |"
        assert row in text, row


def stored_line(number: int) -> DesignLine:
    """A line of docs/results/servo_line.json."""
    tuning = load_tuning(str(ROOT / "docs" / "results" / "servo_line.toml"))
    stored = json.loads((ROOT / "docs" / "results" / "servo_line.json").read_text(encoding="utf-8"))["lines"][number]
    points = [OnTheLine(each["share"], Evaluation(**each["evaluation"]), each["held"]) for each in stored["points"]]
    return DesignLine(tuning, stored["toward"], tuple(points))


@pytest.mark.parametrize("number", [0])
def test_the_lines_are_those_of_the_document(number: int) -> None:
    line = stored_line(number)
    text = (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")
    (table,) = line.report().parts
    assert isinstance(table, Table)
    for row in table.rows:
        if row[0] in {"-0.1", "0", "0.1", "0.2", "0.5", "0.9", "1", "1.1"}:
            assert f"| {' | '.join(row).strip()} |" in text


@pytest.mark.parametrize(("importance", "rates"), [(0.3, 1), (1, 1), (1.6, 1), (4, 1), (1.6, 1.5), (1.6, 2)])
def test_what_the_feedforward_chooses(importance: float, rates: float) -> None:
    tuning, evaluation = searched("published", "servo_gusts_commands")
    entries = copy.deepcopy(dict(tuning.start))
    chosen = entries["feedforward"]
    chosen["importance"] = dict.fromkeys(chosen["importance"], importance)
    chosen["rates"] = {name: rates * value for name, value in chosen["rates"].items()}
    found = evaluation.of(entries)
    whole, failing = found.errors[:2]
    row = f"| {importance:g} | {rates:g} | " + " | ".join(
        f"{np.degrees(each['dihedral']):.3f}" for each in (whole, failing)
    )
    row += f" | {whole[A_Z]:.2f} | {failing[A_Z]:.2f} | {math.degrees(max(found.rates)):.2f} |"
    assert row in (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("design", "worst"), [("servo-gusts", "0.502"), ("servo", "0.306")])
def test_the_worst_error_on_the_line_without_a_feedforward(design: str, worst: str) -> None:
    tuning = replace(load_tuning(str(ROOT / "docs" / "results" / "servo_line.toml")), gusts=())
    entries = {key: value for key, value in read_design(design).items() if key != "feedforward"}
    found = DesignEvaluation(Aircraft(), tuning).of(entries)
    assert f"{math.degrees(max(errors['dihedral'] for errors in found.errors)):.3f}" == worst
    assert f"{worst} deg" in (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("number", [0])
def test_the_ends_of_the_lines_come_out_again(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    monkeypatch.setattr(design_line, "SHARES", (0.0, 1.0))
    monkeypatch.chdir(ROOT / "docs" / "results")
    stored = stored_line(number)
    again = design_line.design_line(Aircraft(), stored.tuning, stored.toward, read_design(stored.toward))
    of_share = {point.share: point for point in stored.points}
    for point in again.points:
        known = of_share[point.share]
        np.testing.assert_allclose(stored.worst(known), again.worst(point), rtol=1e-6)


@pytest.mark.slow
def test_the_trade_off_is_that_of_the_document() -> None:
    text = (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")
    for factor in FACTORS:
        assert row(factor) in text
    assert evaluated(1.0, "newton").abscissa < -0.005
    assert evaluated(8.0, "newton").abscissa > 0.0
