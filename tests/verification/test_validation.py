"""The comparison with the outside: it passes for the identified aircraft and sees every planted error."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from hfa_model import Aircraft, Parameters, load_parameters
from hfa_model.atmosphere import density
from hfa_support.reporting.text import Table
from trim import level_model
from verification import released_trims, validate, validation
from verification.validation import outside_data, third_printed_entries


def test_the_identified_aircraft_passes(published_aircraft: Aircraft) -> None:
    found = validate(published_aircraft)
    assert [check for check in found.checks if not check.ok] == []
    assert {each.speed for each in found.trims} == {68.0, 64.0, 30.0}
    assert max(math.degrees(each.dihedral) for each in found.trims) == pytest.approx(45.0)
    assert len(found.trims) == 20
    assert sum(each.half_unit > 1e-6 for each in found.entries) == 27


def test_first_principles_are_not_what_was_released(parameters: Parameters) -> None:
    found = validate(Aircraft(parameters, "newton"))
    failed = {check.name: check.reason for check in found.checks if not check.ok}
    assert "eigenvalue_30_ft_s" in failed
    assert "A(dihedral_rate, dihedral_rate)" in failed["third_printed_model_half_units"]


@pytest.mark.parametrize(
    ("name", "factor", "check"),
    [
        ("hinge_damping", 1.02, "gibson_fig_7_fast_root"),
        ("hinge_damping", 1.0001, "eigenvalue_30_ft_s"),
        ("zero_lift_moment", 1.01, "deflection_68_ft_s"),
        ("induced_drag", 1.02, "thrust_30_ft_s"),
        ("inertia_pitch", 1.01, "third_printed_model_half_units"),
    ],
)
def test_a_wrong_parameter_is_seen(parameters: Parameters, name: str, factor: float, check: str) -> None:
    wrong = parameters._replace(**{name: getattr(parameters, name) * factor})
    failed = [each for each in validate(Aircraft(wrong)).checks if not each.ok]
    assert check in {each.name for each in failed}
    assert all(each.reason for each in failed)


def test_a_wrong_number_of_theirs_is_seen(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    first, *rest = released_trims()
    moved = first._replace(eigenvalues=(first.eigenvalues[0] + 2e-4, *first.eigenvalues[1:]))
    monkeypatch.setattr(validation, "released_trims", lambda: (moved, *rest))
    failed = [check for check in validate(published_aircraft).checks if not check.ok]
    assert [check.name for check in failed] == ["eigenvalue_68_ft_s"]
    assert failed[0].reason.endswith("1/s at 0 deg")


def test_half_a_unit_of_the_last_printed_digit_and_exact_entries(published_aircraft: Aircraft) -> None:
    model = level_model(published_aircraft, math.radians(10.0))
    entries = {each.name: each for each in third_printed_entries(model)}
    assert entries["A(pitch_rate, dihedral_rate)"].half_unit == pytest.approx(0.005)
    assert entries["A(alpha, speed)"].half_unit == pytest.approx(0.0005)
    assert "B(speed, elevator_center)" not in entries  # what is printed there belongs to another input
    exact = "A(pitch, pitch_rate)"  # printed 1
    assert entries[exact].half_units == 0.0
    A = model.A.copy()
    A[model.states.index("pitch"), model.states.index("pitch_rate")] += 1e-9
    planted = {each.name: each for each in third_printed_entries(dataclasses.replace(model, A=A))}
    assert planted[exact].half_units > 1000.0


def test_the_report_says_everything(published_aircraft: Aircraft) -> None:
    report = validate(published_aircraft).report()
    assert report.title.endswith("PASS")
    assert outside_data()["gibson_2011"]["source"] in report.text()
    assert len(report.data["trims"]) == 20
    assert report.data["ok"] is True
    (entries,) = [part for part in report.parts if isinstance(part, Table) and part.header[0] == "entry"]
    assert len(entries.rows) == 27
    assert "<table>" in report.html()


def test_in_the_air_of_the_simulation_its_values_pass() -> None:
    """The released parameters fail in the standard atmosphere and pass with the simulation's own density."""
    gravity, gas, radius = 32.17405, 1716.55, 20_926_476.0  # ft/s^2, ft^2/(s^2 degR), ft, as the simulation has them
    height = radius * 40_000.0 / (radius + 40_000.0)
    tropopause = 2116.22 / (gas * 518.67) * (389.97 / 518.67) ** (gravity / (0.00356616 * gas) - 1.0)
    thin = tropopause * np.exp(-gravity * (height - 36089.239) / (389.97 * gas)) / density(40_000.0)
    released = load_parameters("gibson-2011-simulation").values
    lifts = ("lift_slope", "aileron_lift", "aileron_moment", "zero_lift_moment", "zero_lift_drag")
    theirs = {name: getattr(released, name) * thin for name in lifts} | {"induced_drag": released.induced_drag / thin}
    assert thin == pytest.approx(1 - 1.61e-5, abs=1e-7)
    assert sum(not check.ok for check in validate(Aircraft(released)).checks) == 4
    assert all(check.ok for check in validate(Aircraft(released._replace(**theirs))).checks)
