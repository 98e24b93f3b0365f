"""Designs between two: their numbers, what they follow and stand, and the picture of it."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path

import pytest
from servo_cases import write_tuning

from controller.design.design_file import read_design
from hfa_model import Aircraft
from verification.synthesis import design_line as module, moving_air
from verification.synthesis.design_evaluation import DesignEvaluation
from verification.synthesis.design_line import between, design_line
from verification.synthesis.tuning import InGust, Tuning
from verification.synthesis.tuning_file import load_tuning


def test_every_number_is_interpolated_by_its_logarithm() -> None:
    first = {"delta": math.inf, "inputs": ["a"], "weights": {"x": 1.0, "y": 0.0, "only": 3.0, "same": 0.0}}
    second = {"delta": 9.0, "inputs": ["b"], "weights": {"x": 100.0, "y": 5.0, "same": 0.0}, "sensors": {"s": 2.0}}
    kept = copy.deepcopy(first)
    found = between(first, second, 0.5)
    assert found["weights"] == pytest.approx({"x": 10.0, "y": 2.5, "only": 3.0, "same": 0.0})
    assert (found["inputs"], found["delta"], found["sensors"]) == (["a"], math.inf, {"s": 2.0})
    assert between(first, second, 1.0)["weights"]["x"] == pytest.approx(100.0)
    assert [between(first, second, share)["weights"]["y"] for share in (-1.0, 0.0, 1.0)] == [0.0, 0.0, 5.0]
    assert first == kept


def small(folder: Path) -> Tuning:
    """With an updraft and a downdraft that are short."""
    tuning = load_tuning(str(write_tuning(folder)))
    gusts = tuple(InGust(tuning.cases[0].dihedral, tuning.cases[0].actuator, 20.0, sign) for sign in (1.0, -1.0))
    return replace(tuning, start=read_design("servo"), gusts=gusts)


def test_a_line_flies_the_designs_on_it(
    published_aircraft: Aircraft, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tuning = small(tmp_path)
    monkeypatch.setattr(module, "SHARES", (0.0, 0.5))
    monkeypatch.setattr(moving_air, "APART", 4.0)
    stiffer = copy.deepcopy(dict(tuning.start))
    stiffer["weights"]["inputs"]["aileron_outer"] *= 4.0
    told: list[tuple[int, int]] = []
    line = design_line(published_aircraft, tuning, "stiffer.toml", stiffer, lambda *done: told.append(done))
    assert told == [(1, 2), (2, 2)]
    evaluation = DesignEvaluation(published_aircraft, tuning)
    assert line.points[0].evaluation == evaluation.of(tuning.start)
    halfway = copy.deepcopy(dict(tuning.start))
    halfway["weights"]["inputs"]["aileron_outer"] *= 2.0
    assert line.points[1].evaluation.cost == pytest.approx(evaluation.of(halfway).cost)
    assert line.points[0].held == evaluation.held(tuning.start)
    error, up, down, rate = line.worst(line.points[0])
    assert error == line.points[0].evaluation.errors[0]["dihedral"]
    assert (up, down) == line.points[0].held
    assert rate == max(line.points[0].evaluation.rates)
    text = line.report().text()
    assert f"Designs from that of {tuning.name} (share 0) to stiffer.toml (share 1)" in text
    assert f"{math.degrees(error):.3f}" in text
    (axes,) = line.figure().axes
    assert axes.lines[0].get_xdata()[0] == pytest.approx(math.degrees(error))
    assert [each.get_text() for each in axes.texts] == ["0", "0.5"]


def test_an_unstable_design_is_said_and_not_drawn(
    published_aircraft: Aircraft, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tuning = small(tmp_path)
    monkeypatch.setattr(module, "SHARES", (0.0,))
    monkeypatch.setattr(DesignEvaluation, "of", lambda *_: module.Evaluation(2e6, math.inf))
    line = design_line(published_aircraft, tuning, "other", tuning.start)
    assert "unstable" in line.report().text()
    assert not line.figure().axes[0].texts
