"""The design `servo`: from three measurements, certified, stable at all corners; what limits any such servo."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import model_at
from scipy.linalg import block_diag, eigvals
from servo_cases import A_Z

from controller import design_controller, design_model, load_design
from controller.design.design import Design
from controller.design.servo_loop import check_corners
from hfa_model import Aircraft

INPUTS = ("aileron_outer", "elevator_center")


@pytest.mark.parametrize(
    ("dynamics", "angles"),
    [
        ("published", [11.0]),
        *(pytest.param(each, range(21), marks=pytest.mark.slow) for each in ("published", "newton")),
    ],
)
def test_it_is_certified_and_every_corner_is_stable(dynamics: str, angles: list[float]) -> None:
    aircraft = Aircraft(dynamics=dynamics)
    controller = design_controller(aircraft, load_design("servo"), np.radians(angles))
    assert (controller.measurements, controller.inputs) == (("pitch_rate", "dihedral", A_Z), INPUTS)
    assert all(check["ok"] for row in controller.about["angles"] for check in row["checks"])
    found = check_corners(aircraft, controller)
    assert (found.unstable, found.loops) == (0, 32 * len(angles))


def transmission_zeros(dynamics: str, degrees: float, outputs: tuple[str, ...]) -> np.ndarray:
    """s at which [A - s I, B; C, D] loses rank: poles of the loop when both outputs are held as tightly as can be."""
    design = Design("zeros", INPUTS, sensors=dict.fromkeys(outputs, 1.0), input_weights=dict.fromkeys(INPUTS, 1.0))
    built = design_model(Aircraft(dynamics=dynamics), model_at(degrees, dynamics), design)
    pencil = np.block([[built.A, built.B], [built.C, built.D]])
    found = eigvals(pencil, block_diag(np.eye(len(built.A)), np.zeros(built.D.shape)))
    return np.asarray(found[np.isfinite(found) & (np.abs(found) < 1e6)])


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize("degrees", [5.0, 11.0, 20.0])
def test_who_holds_dihedral_and_acceleration_tightly_leaves_the_phugoid_undamped(dynamics: str, degrees: float) -> None:
    """The zeros at 0.67 rad/s are what gusts excite: A_z must be held loosely. Pitch in its place has none there."""
    zeros = transmission_zeros(dynamics, degrees, ("dihedral", A_Z))
    slow = zeros[(np.abs(zeros) < 1.0) & (zeros.imag > 0.0)]
    assert np.abs(slow) == pytest.approx([0.67], abs=0.01)
    assert 0.0 < -slow[0].real / np.abs(slow[0]) < 0.035
    assert (zeros.real > 1.8).any()  # and none can follow A_z faster than this
    assert np.abs(transmission_zeros(dynamics, degrees, ("dihedral", "pitch")).imag).max() < 1e-6
