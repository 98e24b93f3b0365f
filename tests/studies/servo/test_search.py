"""The search for weights: its cost, its file, its way to the least, its continuation; the tables of findings.md."""

from __future__ import annotations

import copy
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import ROOT
from servo_cases import A_Z, write_tuning

from controller import load_design
from controller.design.design import Actuator
from hfa_model import Aircraft
from hfa_support import BadInputError
from studies.servo import search
from studies.servo.search import LOST, PENALTY, SHARES, DesignEvaluation, Evaluation, line_report, search_report, tune
from studies.servo.tuning import InGust, InTurbulence, Tuning, Variable, design_entries, load_tuning, save_design

RESULTS = ROOT / "studies" / "servo" / "results"
FINDINGS = (RESULTS.parent / "findings.md").read_text(encoding="utf-8")
AT_11 = math.radians(11.0), Actuator()


def on_servo(folder: Path, **changed: Any) -> Tuning:
    """The small search on the design `servo`, in turbulence and a gust."""
    air, gust = InTurbulence(*AT_11, {"dihedral": 50.0}), InGust(*AT_11, 250.0, 1.0)
    settings = {"turbulence": (air,), "gusts": (gust,), "margin": 0.01, "abscissa": -1e-6, "fastest": 1e5}
    return replace(load_tuning(str(write_tuning(folder))), start=design_entries("servo"), **(settings | changed))


def test_the_cost_is_what_it_says(tmp_path: Path, published_aircraft: Aircraft) -> None:
    def evaluated(**changed: Any) -> Evaluation:
        asked = on_servo(tmp_path, **changed)
        return DesignEvaluation(published_aircraft, asked).of(asked.start)

    found = evaluated()
    rms, error = found.rms[0]["dihedral"], found.errors[0]["dihedral"]
    assert found.cost == pytest.approx(100.0 * error + 50.0 * rms)
    assert evaluated(power=6.0).cost == pytest.approx(((100.0 * error) ** 6 + (50.0 * rms) ** 6) ** (1 / 6))
    larger = InGust(*AT_11, 250.0, -90.0, "newton")
    missed = evaluated(margin=2.0 * found.margin, fastest=found.fastest / 3.0, gusts=(larger,))
    assert missed.cost == pytest.approx(found.cost + PENALTY * (0.5 + 2.0 + missed.gusts[0] - 1.0))
    assert missed.gusts[0] > 1.0
    weak = InTurbulence(AT_11[0], Actuator(2, 0.2, 0.3), {"dihedral": 50.0})  # the case itself is not stable
    lost = evaluated(turbulence=(weak,))
    assert lost.cost == pytest.approx(LOST * (1.0 + lost.abscissa))
    variable = Variable("effort", ("weights.inputs.aileron_outer",), 1e-320, 1e4)
    evaluation = DesignEvaluation(published_aircraft, on_servo(tmp_path, variables=(variable,)))
    assert evaluation.at(np.array([1e-320])) == Evaluation(2.0 * LOST, math.inf)


def test_an_evaluation_that_ends_early_ends_above_its_limit(tmp_path: Path, published_aircraft: Aircraft) -> None:
    asked = on_servo(tmp_path, margin=10.0, power=3.0)
    evaluation, values = DesignEvaluation(published_aircraft, asked), asked.first_values()
    whole = evaluation.at(values)
    for below in (0.0, 1500.0, whole.cost - 1e-6, whole.cost):
        found = evaluation.at(values, below)
        assert (found.cost > below) == (whole.cost > below)
        assert found.cost <= whole.cost
    assert found == whole


def narrow(values: np.ndarray) -> float:
    """A bent valley, 1 at its end, behind a step: most of the box is lost."""
    x = np.log(values / 7.0)
    cost = 1.0 + float(np.sum(3.0 * (x[1:] - 0.3 * x[:-1] ** 2) ** 2) + np.sum(x**2))
    return cost if cost < 2000.0 else LOST + cost


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_of_many_variables_it_finds_the_least_cost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft, seed: int
) -> None:
    tuning = load_tuning(str(write_tuning(tmp_path)))
    many = tuple(Variable(f"v{k}", tuning.variables[0].entries, 1e-3, 1e5) for k in range(12))

    def at(_: object, values: np.ndarray, below: float) -> Evaluation:
        return Evaluation(min(narrow(values), float(np.nextafter(below, np.inf))), -1.0)

    monkeypatch.setattr(search.DesignEvaluation, "at", at)
    found = tune(published_aircraft, replace(tuning, variables=many, evaluations=600, seed=seed), tmp_path / "kept")
    assert len(found.seen) == 600
    assert found.first_evaluation.cost > 60.0
    assert found.best_evaluation.cost == narrow(found.best) == min(each.cost for each in found.seen) < 1.3


def test_a_search_goes_on_where_it_ended_and_computes_anew_what_is_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft
) -> None:
    tuning, kept = load_tuning(str(write_tuning(tmp_path, evaluations=15))), tmp_path / "kept"
    tune(published_aircraft, replace(tuning, evaluations=6), kept)
    (kept / "00003.json").write_text((kept / "00003.json").read_text("utf-8").replace("1", "2", 1), encoding="utf-8")
    made: list[float] = []
    plain = DesignEvaluation.at
    monkeypatch.setattr(DesignEvaluation, "at", lambda *of: (made.append(1.0), plain(*of))[1])
    again, whole = tune(published_aircraft, tuning, kept), tune(published_aircraft, tuning, tmp_path / "whole")
    assert len(made) == 10 + 15
    assert again.seen == whole.seen
    np.testing.assert_array_equal(again.best, whole.best)
    report = search_report(tuning, again)
    assert (report.data["ok"], report.data["best"]["cost"]) == (
        False,
        whole.best_evaluation.cost,
    )
    save_design(tmp_path / "best.toml", tuning.entries_at(again.best))
    assert load_design(str(tmp_path / "best.toml")).input_weights["aileron_outer"] == again.best[0]


@pytest.mark.parametrize(
    ("right", "wrong", "named"),
    [
        ("dihedral = 100.0", "pitch = 1.0", "objective.pitch is 1.0"),
        ("dihedral = 100.0", "dihedral = nan", "objective.dihedral is nan"),
        ("low = 5.0", "low = 5000.0", "variables.effort: give entries, and low below high"),
        (f"{A_Z} = [-1.0, 0.5]", f"{A_Z} = [-1.0]", "inhomogeneous"),
        ("angles = [11]", "angles = 5", "angles is 5; give a list of degrees"),
        ("angles = [11]", "angels = [11]", "'angles' is missing"),
        ("angles = [11]", 'angles = [11]\ndynamics = ["euler"]', "'euler' is missing or unknown"),
        ("rate = 1.0", "rate = 0.0", "rate is 0.0; give a positive number"),
        ("seed = 1", "sed = 1", "unexpected keyword argument 'sed'"),
        ("effectiveness = 0.7", 'effectiveness = "much"', "effectiveness of an actuator is 'much'"),
    ],
)
def test_what_is_wrong_in_the_file_is_named(tmp_path: Path, right: str, wrong: str, named: str) -> None:
    path = write_tuning(tmp_path)
    path.write_text(path.read_text("utf-8").replace(right, wrong), encoding="utf-8")
    with pytest.raises(BadInputError, match=rf"tune\.toml: .*{re.escape(named)}"):
        load_tuning(str(path))


@pytest.mark.parametrize(
    "name", ["search", "gusts_commands_search", pytest.param("gusts_search", marks=pytest.mark.slow)]
)
def test_what_was_found_keeps_the_constraints_of_its_search(published_aircraft: Aircraft, name: str) -> None:
    tuning = load_tuning(str(RESULTS / f"{name}.toml"))
    found = DesignEvaluation(published_aircraft, tuning).at(tuning.first_values())
    assert (found.abscissa <= tuning.abscissa, max(found.rates) <= tuning.rate) == (True, True)
    assert (found.margin >= tuning.margin, found.fastest <= tuning.fastest) == (True, True)
    assert max(found.gusts, default=0.0) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("words", "name"), [("found", "from_simvfa_found.toml"), ("`servo-gusts`", "servo-gusts")])
def test_what_the_search_from_simvfa_found(published_aircraft: Aircraft, words: str, name: str) -> None:
    tuning = load_tuning(str(RESULTS / "from_simvfa.toml"))
    found = DesignEvaluation(published_aircraft, tuning).of(design_entries(name, RESULTS))
    missed = [math.degrees(each["dihedral"]) for each in (*found.rms, *found.errors)]
    cells = [f"{found.cost:.3f}", *(f"{each:.3f}" for each in missed), f"{max(e[A_Z] for e in found.errors):.2f}"]
    assert f"| {words} | {' | '.join(cells)} | {max(found.gusts):.2f} |" in FINDINGS


def test_the_line_is_that_of_the_findings() -> None:
    stored = json.loads((RESULTS / "line.json").read_bytes())["lines"][0]
    (table,) = line_report(load_tuning(str(RESULTS / "line.toml")), stored["toward"], stored["points"]).parts
    for row in table.rows:
        if row[0] in {"-0.1", "0", "0.1", "0.2", "0.5", "0.9", "1", "1.1"}:
            assert f"| {' | '.join(row).strip()} |" in FINDINGS
    assert [point["share"] for point in stored["points"]] == list(SHARES)


@pytest.mark.parametrize(("importance", "rates"), [(1.6, 1), (0.3, 1), (1.6, 2)])
def test_what_a_feedforward_chooses(published_aircraft: Aircraft, importance: float, rates: float) -> None:
    tuning = load_tuning(str(RESULTS / "gusts_commands_search.toml"))
    entries = copy.deepcopy(dict(tuning.start))
    chosen = entries["feedforward"]
    chosen["importance"] = dict.fromkeys(chosen["importance"], importance)
    chosen["rates"] = {name: rates * value for name, value in chosen["rates"].items()}
    found = DesignEvaluation(published_aircraft, tuning).of(entries)
    whole, failing = found.errors[:2]
    missed = " | ".join(f"{np.degrees(each['dihedral']):.3f}" for each in (whole, failing))
    rest = f"{whole[A_Z]:.2f} | {failing[A_Z]:.2f} | {math.degrees(max(found.rates)):.2f}"
    assert f"| {importance:g} | {rates:g} | {missed} | {rest} |" in FINDINGS
