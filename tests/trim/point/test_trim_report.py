"""What a trim says: for people every variable, limit and verdict in 100 columns; for files the same in numbers."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from cli import hfa
from random_points import RATE_SCALES

from hfa_model import Aircraft
from hfa_model.aircraft import HFA
from hfa_support import Report
from trim import OperatingPoint, TrimCondition, find_operating_point, level_flight, release, trim_report
from trim.point.trim_report import all_margins

BASE = level_flight(float(np.radians(10.0)))


def reported(aircraft: Aircraft, condition: TrimCondition) -> tuple[OperatingPoint, Report]:
    point = find_operating_point(aircraft, condition)
    return point, trim_report(aircraft, condition, point)


def test_every_variable_is_shown_with_its_limits_and_the_margin_to_one(published_aircraft: Aircraft) -> None:
    condition = release(BASE, free=("alpha",), hold={"aileron_outer": 0.0})
    point, report = reported(published_aircraft, condition)
    said = report.text()
    for name, margin in all_margins(condition, point).items():
        factor = math.degrees(1.0) if HFA.unit(name).startswith("rad") else 1.0
        limits = "" if math.isinf(margin.lowest) else f" +{margin.lowest * factor:.6g} +{margin.highest * factor:.6g}"
        to = f" +{margin.distance * factor:.5f} +{margin.nearer}" if margin.nearer else ""
        role = "imposed" if margin.role == "held" else margin.role
        assert re.search(rf"^{name} +{margin.value * factor:.5f} +\S+ +{role}{limits}{to}$", said, re.M), name
    assert re.search(r"^alpha +3\.18040 +deg +free +-20 +20 +16\.81960 +highest$", said, re.M)
    assert re.search(r"^pitch +3\.18040 +deg +follows +-60 +60 +56\.81960 +highest$", said, re.M)
    assert re.search(r"^aileron_outer +0\.00000 +deg +imposed +-20 +20 +20\.00000 +lowest$", said, re.M)


def test_what_binds_is_said(published_aircraft: Aircraft) -> None:
    limited = level_flight(math.radians(10.0), limits={"elevator_outer": (math.radians(-2.0), 0.5)})
    _, report = reported(published_aircraft, release(limited, free=("aileron_center",)))
    assert re.search(r"^elevator_outer, lowest +-2 +0\.00000 +deg +0\.0 % +BINDS$", report.text(), re.M)
    assert report.data["binding"] == ["elevator_outer"]
    _, glide = reported(published_aircraft, release(BASE, free=("gamma",), hold={"throttle": 0.0}))
    assert re.search(r"^throttle, lowest +0 +0\.00000 +1 +0\.0 % +held there$", glide.text(), re.M)
    assert glide.data["binding"] == []


def test_each_equation_has_its_tolerance_and_its_verdict(published_aircraft: Aircraft) -> None:
    """A residual planted just above the tolerance of one equation fails that one alone."""
    point, report = reported(published_aircraft, BASE)
    assert len(re.findall(r"^rate of .* PASS$", report.text(), re.M)) == len(HFA.steady)
    assert "FAIL" not in report.text()
    assert all(each["ok"] for each in report.data["equations"].values())
    for name in HFA.steady:
        tolerance = 1e-10 * getattr(RATE_SCALES, name)
        assert report.data["equations"][name]["tolerance"] == pytest.approx(tolerance)
        for factor, verdict in ((1.01, "FAIL"), (-1.01, "FAIL"), (0.99, "PASS")):
            planted = replace(point, residuals=point.residuals | {name: factor * tolerance})
            found = trim_report(published_aircraft, BASE, planted)
            assert re.search(rf"^rate of {name} .* {verdict}$", found.text(), re.M)
            failed = [each for each, entry in found.data["equations"].items() if not entry["ok"]]
            assert failed == ([name] if verdict == "FAIL" else [])


def test_loads_and_performance_agree_with_each_other(published_aircraft: Aircraft) -> None:
    point, report = reported(published_aircraft, BASE)
    said, loads = report.text(), published_aircraft.loads(point.states, point.inputs)
    rows = {line.split("  ")[0]: re.findall(r"-?\d[\d.]*", line) for line in said.splitlines()}
    weight, lift, coefficient = (np.array(rows[name][:3], float) for name in ("weight", "lift", "lift coefficient"))
    np.testing.assert_allclose(lift, [loads.lift, loads.center.lift, loads.outer.lift], atol=6e-5)
    pressure = float(rows["dynamic pressure q"][0])
    np.testing.assert_allclose(coefficient * pressure * np.array([1920.0, 640.0, 640.0]), lift, rtol=5e-4)
    assert weight[0] == pytest.approx(weight[1] + 2 * weight[2], abs=2e-4)
    assert weight[0] == pytest.approx(loads.lift + loads.thrust * math.sin(point.states.alpha), abs=1e-3)
    assert rows["Mach number"][0] == f"{68.0 / (295.07 / 0.3048):.4g}"
    assert rows["with hinge spring"] == ["0.0000"]


@pytest.mark.parametrize("command", ["trim", "linearize"])
def test_a_trim_that_fails_is_data_too(command: str) -> None:
    """The nearest point within the limits, what binds and why; exit code 1 and the sentence as without --json."""
    words = (command, "--dihedral", "10", "--limit", "throttle=0:30")
    found, plain = hfa(*words, "--json"), hfa(*words)
    assert (found.code, plain.code, plain.out) == (1, 1, "")
    assert found.err == plain.err
    data = json.loads(found.out)
    assert (data["status"], data["binding"]) == ("failed", ["throttle"])
    assert found.err.startswith(f"hfa: {data['reason'][:60]}")
    assert data["operating_point"]["inputs"]["throttle"] == 30.0
    assert not data["equations"]["speed"]["ok"]
