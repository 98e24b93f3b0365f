"""Linear models: names that travel, and the printed matrices regenerated."""

from __future__ import annotations

import control
import numpy as np
import pytest

from hfa_model import INPUTS, STATES, Aircraft, Parameters, published_models
from hfa_model.printed_matrices import PublishedModel
from hfa_support import BadInputError
from trim import LinearModel, compare, find_operating_point, level_flight, linearize, regenerate
from trim.identification.identification_result import IDENTIFIED
from trim.linear.compare import eigenvalue_errors


@pytest.fixture(scope="module")
def model(published_aircraft: Aircraft) -> LinearModel:
    return linearize(
        published_aircraft, find_operating_point(published_aircraft, level_flight(float(np.radians(15.0)))), full=True
    )


def test_select_takes_rows_and_columns_by_name(model: LinearModel) -> None:
    part = model.select(("pitch_rate", "speed"))
    q, speed = STATES.index("pitch_rate"), STATES.index("speed")
    expected = np.array([[model.A[q, q], model.A[q, speed]], [model.A[speed, q], model.A[speed, speed]]])
    np.testing.assert_array_equal(part.A, expected)
    np.testing.assert_array_equal(part.B, model.B[[q, speed]])
    assert part.states == ("pitch_rate", "speed")
    assert part.state_units == ("rad/s", "ft/s")
    np.testing.assert_array_equal(part.state_offsets, [0.0, 68.0])
    with pytest.raises(BadInputError, match="unknown state 'yaw'"):
        model.select(("speed", "yaw"))


def test_to_control_keeps_names_and_numbers(model: LinearModel) -> None:
    system = model.to_control()
    assert isinstance(system, control.StateSpace)
    assert tuple(system.state_labels) == tuple(system.output_labels) == STATES
    assert tuple(system.input_labels) == INPUTS
    for there, here in ((system.A, model.A), (system.B, model.B), (system.C, np.eye(7)), (system.D, np.zeros((7, 5)))):
        np.testing.assert_array_equal(there, here)


def test_outputs_go_with_the_model(model: LinearModel, published_aircraft: Aircraft) -> None:
    names = ("load_factor", "speed")
    watched = linearize(published_aircraft, model.point, outputs=names)
    assert (watched.outputs, watched.output_units, watched.C.shape, watched.D.shape) == (
        names,
        ("1", "ft/s"),
        (2, 6),
        (2, 5),
    )
    part = watched.select(("alpha", "speed"), ("throttle",))
    np.testing.assert_array_equal(part.C, watched.C[:, [1, 0]])
    np.testing.assert_array_equal(part.D, watched.D[:, [0]])
    np.testing.assert_array_equal(part.C[1], [0.0, 1.0])
    system = part.to_control()
    assert (tuple(system.output_labels), tuple(system.input_labels)) == (names, ("throttle",))
    np.testing.assert_array_equal(system.C, part.C)
    np.testing.assert_array_equal(system.D, part.D)
    assert part == linearize(published_aircraft, model.point, outputs=names).select(("alpha", "speed"), ("throttle",))
    with pytest.raises(BadInputError, match="unknown output 'lift'; choose from speed"):
        linearize(published_aircraft, model.point, outputs=("lift",))
    with pytest.raises(BadInputError, match="unknown input 'flaps'"):
        model.select(inputs=("flaps",))
    with pytest.raises(BadInputError, match="state speed is named twice"):
        model.select(("speed", "speed"))


def test_a_point_of_other_dynamics_is_refused(model: LinearModel, parameters: Parameters) -> None:
    with pytest.raises(BadInputError, match="trimmed with 'published' dynamics, the aircraft has 'newton'"):
        linearize(Aircraft(parameters, "newton"), model.point)


# The printed matrices.


def half_units(model: LinearModel, published: PublishedModel) -> float:
    """Largest |computed - printed| in half units of the last printed digit."""
    A = np.abs(model.A - published.A) / published.half_unit_A
    B = np.abs(model.B - published.B) / published.half_unit_B
    return float(max(A.max(), B.max()))


@pytest.mark.parametrize("published", published_models(), ids=lambda published: f"{published.dihedral_deg:g}deg")
def test_every_printed_entry_is_regenerated(published_aircraft: Aircraft, published: PublishedModel) -> None:
    computed = regenerate(published_aircraft, published)
    assert half_units(computed, published) <= 3.0
    rows = compare(computed, published)
    assert len(rows) == 66
    assert max(abs(row.half_units) for row in rows) == pytest.approx(half_units(computed, published), rel=1e-12)


@pytest.mark.parametrize("published", published_models(), ids=lambda published: f"{published.dihedral_deg:g}deg")
@pytest.mark.parametrize("name", IDENTIFIED)
def test_a_parameter_one_percent_off_is_seen(parameters: Parameters, published: PublishedModel, name: str) -> None:
    wrong = Aircraft(parameters._replace(**{name: getattr(parameters, name) * 1.01}))
    assert half_units(regenerate(wrong, published), published) > 3.0


@pytest.mark.parametrize("published", published_models(), ids=lambda published: f"{published.dihedral_deg:g}deg")
def test_eigenvalues_of_the_print_are_regenerated(published_aircraft: Aircraft, published: PublishedModel) -> None:
    printed = np.linalg.eigvals(published.A)
    computed = np.linalg.eigvals(regenerate(published_aircraft, published).A)
    allowed = np.where(np.abs(printed) < 0.5, 5e-4, 2e-3 * np.abs(printed))
    errors = eigenvalue_errors(computed, printed)
    assert np.all(errors <= allowed), errors / allowed


def test_the_phugoid_is_unstable_at_15_degrees_and_stable_at_5(published_aircraft: Aircraft) -> None:
    """So it is in the print, and so it must be after regeneration."""
    for published, unstable in zip(published_models(), (True, False), strict=True):
        for A in (published.A, regenerate(published_aircraft, published).A):
            slow = [value for value in np.linalg.eigvals(A) if 0.5 < abs(value) < 1.0]
            assert len(slow) == 2
            assert [value.real > 0 for value in slow] == [unstable, unstable]


def test_quoted_eigenvalues_at_5_degrees(published_aircraft: Aircraft) -> None:
    """The paper quotes |λ| of 7.11, 0.019 and 4.82 ± 18.66i from Ma and Peng (2021): met to a last digit.

    Its fourth pair, 0.016 ± 0.64i, belongs to other numbers than the printed matrix, which has 0.0144 ± 0.751i.
    """
    found = np.linalg.eigvals(regenerate(published_aircraft, published_models()[1]).A)
    quoted = np.array([-7.11, -0.019, -4.82 + 18.66j, -4.82 - 18.66j])
    allowed = np.array([0.01, 0.001, np.hypot(0.01, 0.01), np.hypot(0.01, 0.01)])
    errors = eigenvalue_errors(found, quoted)
    assert np.all(errors <= allowed), errors
