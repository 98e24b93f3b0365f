"""Comparison with external data. The identified aircraft passes, and planted errors are detected.

The data also determine how each inertia depends on the dihedral angle.
"""

import math

import casadi as ca
import numpy as np
import pytest
from standard_air import density

import hfa
from hfa_model import VARIANTS, load_parameters
from studies.validation import outside
from studies.validation.outside import (
    released_trims,
    validate,
)


def failed(found):
    """Return the names of the checks that fail."""
    return {check.name for check in found.checks if not check.ok}


def test_the_identified_aircraft_passes(published_aircraft):
    """The identified aircraft passes all checks: at 20 trims of the released simulation, at 68, 64 and
    30 ft/s with dihedral angles up to 45 deg, and for a third printed model.

    Of the entries of this model, 27 are printed with decimals, and thus rounded.
    """
    validation = validate(published_aircraft)
    assert not failed(validation)
    assert {trim.speed for trim in validation.trims} == {68.0, 64.0, 30.0}
    assert max(math.degrees(trim.dihedral) for trim in validation.trims) == pytest.approx(45.0)
    assert len(validation.trims) == 20
    # The other printed entries are integers, which are exact.
    assert sum(entry.half_unit > outside.ROUNDING for entry in validation.entries) == 27


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
def test_a_wrong_parameter_fails_its_check(parameters, name, factor, check):
    """A wrong parameter fails the check that is expected for it, and every failed check has a
    reason.
    """
    wrong = parameters._replace(**{name: getattr(parameters, name) * factor})
    failing = [each for each in validate(hfa.aircraft(parameters=wrong)).checks if not each.ok]
    assert check in {each.name for each in failing}
    assert all(each.reason for each in failing)


def test_a_wrong_eigenvalue_fails_its_check(published_aircraft, monkeypatch):
    """If one eigenvalue of the released simulation, at 68 ft/s and 0 deg, is off by 2e-4, the check of the
    eigenvalues at 68 ft/s fails, and no other.
    """
    first, *rest = released_trims()
    moved = first._replace(eigenvalues=(first.eigenvalues[0] + 2e-4, *first.eigenvalues[1:]))
    # The planted fault: a wrong number of the released simulation.
    monkeypatch.setattr(outside, "released_trims", lambda: (moved, *rest))
    failing = [check for check in validate(published_aircraft).checks if not check.ok]
    assert [check.name for check in failing] == ["eigenvalue_68_ft_s"]
    assert failing[0].reason.endswith("1/s at 0 deg")


def test_released_parameters_pass_with_their_air_density():
    """The parameters of the released simulation pass with the air density of this simulation, whose
    constants differ from the standard atmosphere: at 40,000 ft, it is 1.61e-5 thinner.

    With the density of the standard atmosphere, they fail four checks.
    """
    # Constants of the simulation, in ft/s^2, ft^2/(s^2 degR) and ft; height is the geopotential one.
    gravity, gas, radius = 32.17405, 1716.55, 20_926_476.0
    height = radius * 40_000.0 / (radius + 40_000.0)
    tropopause = (
        2116.22 / (gas * 518.67) * (389.97 / 518.67) ** (gravity / (0.00356616 * gas) - 1.0)
    )
    thin = (
        tropopause
        * np.exp(-gravity * (height - 36089.239) / (389.97 * gas))
        / float(density(40_000.0))
    )
    released = load_parameters("gibson-2011-simulation").values
    # Aerodynamic forces are proportional to the density; induced drag is CL² times this parameter.
    lifts = ("lift_slope", "aileron_lift", "aileron_moment", "zero_lift_moment", "zero_lift_drag")
    theirs = {name: getattr(released, name) * thin for name in lifts} | {
        "induced_drag": released.induced_drag / thin
    }
    assert thin == pytest.approx(1 - 1.61e-5, abs=1e-7)
    assert len(failed(validate(hfa.aircraft(parameters=released)))) == 4
    assert not failed(validate(hfa.aircraft(parameters=released._replace(**theirs))))


Published = type(VARIANTS["published"])


def off_at(dihedral, degrees, size):
    """Return a factor that is 1 + size at one dihedral angle, and 1 a few degrees away from it."""
    return 1 + size * ca.exp(-((50 * (dihedral - np.radians(degrees))) ** 2))


def test_an_inertia_error_at_one_angle_is_detected(parameters):
    """A hinge inertia that is 2e-5 too large near the released angle of 15 deg fails the eigenvalues at
    30 ft/s.
    """

    class Off(Published):
        def hinge_inertia(self, dihedral, p):
            return super().hinge_inertia(dihedral, p) * off_at(dihedral, 15.0, 2e-5)

    assert "eigenvalue_30_ft_s" in failed(validate(hfa.aircraft(Off(), parameters)))
