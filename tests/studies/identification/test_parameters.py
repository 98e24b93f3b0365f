"""Identification of aircraft with known parameters, and of matrices that no aircraft can have."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa_model import INPUTS, LINEAR_STATES, VARIANTS, Parameters, State, published_models
from studies.identification.parameters import ALTERNATIVES, IDENTIFIED, ROUGH, Fit, fit, identify
from trim import compare, regenerate

pytestmark = pytest.mark.slow

MOVED = tuple(name for name in LINEAR_STATES if name not in ("pitch", "dihedral"))
ENTRIES = [("A", row, column) for row in MOVED for column in LINEAR_STATES] + [
    ("B", row, column) for row in MOVED for column in INPUTS
]


def made_up(parameters: Parameters, rng: np.random.Generator) -> Parameters:
    """Return random parameters: each identified parameter is multiplied by a factor in
    exp(±0.2).
    """
    factors = np.exp(rng.uniform(-0.2, 0.2, len(IDENTIFIED)))
    return parameters._replace(
        **{
            name: getattr(parameters, name) * factor
            for name, factor in zip(IDENTIFIED, factors.tolist(), strict=True)
        }
    )


def printed(parameters: Parameters) -> list[Any]:
    """Return the matrices A and B of an aircraft at both printed angles, rounded as in the
    paper.
    """
    models = []
    for published in published_models():
        exact = regenerate(hfa.aircraft(parameters=parameters), published)
        A = 2 * published.half_unit_A * np.round(exact.A / (2 * published.half_unit_A))
        B = 2 * published.half_unit_B * np.round(exact.B / (2 * published.half_unit_B))
        models.append(replace(published, A=A, B=B))
    return models


def changed(matrix: str, row: str, column: str) -> tuple[Any, Any]:
    """Return the paper's matrices with 0.01 added to one entry of the pair at 5 deg."""
    at_15, at_5 = published_models()
    entries = getattr(at_5, matrix).copy()
    entries[
        LINEAR_STATES.index(row), (LINEAR_STATES if matrix == "A" else INPUTS).index(column)
    ] += 0.01
    return at_15, replace(at_5, **{matrix: entries})


def errors_in_standard_errors(found: Fit, truth: Parameters) -> np.ndarray:
    errors = found.parameters.standard_errors
    return np.array(
        [
            (getattr(found.parameters.values, name) - getattr(truth, name)) / errors[name]
            for name in IDENTIFIED
        ]
    )


@pytest.fixture(scope="module")
def identified() -> tuple[Fit, list[float]]:
    return identify(seed=0)


def test_all_initial_guesses_give_the_same_fit(
    identified: tuple[Fit, list[float]],
) -> None:
    """All rough initial guesses lead to the same fit. Its errors are as small as rounding
    permits.
    """
    best, sums = identified
    assert len(sums) == 8
    np.testing.assert_allclose(sums, best.sum_of_squares, rtol=1e-6)
    # The rough guess is not near the solution.
    guess = np.array(list(ROUGH.values()))
    answer = np.array([getattr(best.parameters.values, n) for n in IDENTIFIED])
    assert np.median(np.abs(guess / answer - 1)) > 0.1
    assert best.entries == 70
    assert best.sum_of_squares < 1.5 * best.expected_sum
    assert best.largest < 1.5


def test_known_aircraft_are_recovered_within_their_standard_errors(parameters: Parameters) -> None:
    """The errors of the estimates of twenty known aircraft agree with the standard errors.

    The matrices are rounded as in the paper.
    """
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(20):
        truth = made_up(parameters, rng)
        found = fit(printed(truth), VARIANTS["published"])
        assert found.largest < 2.0
        rows.append(errors_in_standard_errors(found, truth))
        # The test can fail: 1 % of any constant is many standard errors.
        wrong = Parameters(*(1.01 * np.array(truth)).tolist())
        assert np.abs(errors_in_standard_errors(found, wrong)).min() > 5.0
    deviations = np.array(rows)
    assert np.abs(deviations).max() < 5.0
    # The mean is about 1. The mean of 20 squares of nearly uniform errors scatters by about 0.2. If
    # the standard errors were too small by a factor of sqrt(2), it would be 2.
    squares = (deviations**2).mean(axis=0)
    assert np.all((squares > 0.4) & (squares < 1.6)), dict(
        zip(IDENTIFIED, squares.round(2).tolist(), strict=True)
    )


@pytest.mark.parametrize("matrix_row_column", ENTRIES[1::8], ids="-".join)
def test_one_changed_entry_prevents_a_fit(
    parameters: Parameters, matrix_row_column: tuple[str, str, str]
) -> None:
    """If one printed entry at 5 deg is changed by 0.01, no parameters fit all entries."""
    near = np.log(
        np.array([getattr(parameters, name) for name in IDENTIFIED]) / list(ROUGH.values())
    )
    found = fit(changed(*matrix_row_column), VARIANTS["published"], noise=near)
    assert found.sum_of_squares > 5 * found.expected_sum


@pytest.mark.parametrize(
    ("description", "variant"), [pytest.param(*each, id=each[0]) for each in ALTERNATIVES]
)
def test_each_departure_from_newton_is_needed(description: str, variant: Any) -> None:
    """If a term of the published dynamics is replaced by Newton's, some entry cannot be fitted.

    The largest difference exceeds 1000 half units of the last printed digit.
    """
    found = fit(published_models(), variant)
    assert found.largest > 1000.0, description


@pytest.mark.parametrize(
    ("speed", "square", "is_fitted"),
    [
        # The pitch-rate term with Newton's sign, the dihedral-rate term left out, the square with
        # Newton's factor.
        (lambda x: -ca.cos(x.dihedral) * ca.cos(x.alpha) * x.pitch_rate, 0.0, False),
        (lambda x: ca.sin(x.alpha) * ca.sin(x.dihedral) * x.dihedral_rate / 2, 0.0, False),
        (lambda x: 0.0, 1 / 6, True),
    ],
)
def test_two_terms_of_the_coupling_are_needed(
    speed: Callable[[State], Any], square: float, is_fitted: bool
) -> None:
    """If one of two terms of the hinge coupling is changed, some printed entry cannot be fitted.

    A term with the squared rate does not prevent the fit. The added terms are m s V times `speed`
    and m s² cos η sin η η'² times `square`.
    """

    def coupling(self: Any, x: State, p: Parameters) -> Any:
        of_square = p.panel_span * ca.cos(x.dihedral) * ca.sin(x.dihedral) * x.dihedral_rate**2
        more = p.panel_mass * p.panel_span * (speed(x) * x.speed + square * of_square)
        return VARIANTS["published"].hinge_coupling(x, p) + more

    variant = type("Changed", (type(VARIANTS["published"]),), {"hinge_coupling": coupling})()
    assert (fit(published_models(), variant).largest < 1.5) == is_fitted


def test_the_expected_sum_equals_the_simulated_mean(
    parameters: Parameters, identified: tuple[Fit, list[float]]
) -> None:
    """The expected sum of squares of a fit equals the mean for simulated rounding errors.

    The errors are uniform within half a unit, and equal for a number that is printed at both
    angles. A sum contains only errors that no change of the parameters can reduce. The derivatives
    are finite differences.
    """
    models = published_models()

    def entries(values: Parameters) -> np.ndarray:
        pairs = [(regenerate(hfa.aircraft(parameters=values), model), model) for model in models]
        parts = [
            (exact.A / model.half_unit_A, exact.B / model.half_unit_B) for exact, model in pairs
        ]
        return np.stack([np.concatenate([A.ravel(), B.ravel()]) for A, B in parts])

    columns = []
    for name in IDENTIFIED:
        value = getattr(parameters, name)
        high, low = (
            entries(parameters._replace(**{name: value * (1 + step)})) for step in (1e-4, -1e-4)
        )
        columns.append((high - low) / 2e-4)
    derivatives = np.stack(columns, axis=-1)  # (angle, entry, parameter)
    moved = np.abs(derivatives).max(axis=(0, 2)) > 1e-3
    derivatives = derivatives[:, moved]
    alike = np.abs(derivatives[0] - derivatives[1]).max(axis=1) < 1e-6 * np.abs(derivatives[0]).max(
        axis=1
    )
    assert (derivatives.shape[1], np.count_nonzero(alike)) == (35, 5)
    errors = np.random.default_rng(0).uniform(-1, 1, (20_000, 2, 35))
    errors[:, 1, alike] = errors[:, 0, alike]
    flat = errors.reshape(-1, 70)
    fitted, _ = np.linalg.qr(derivatives.reshape(70, -1))
    sums = ((flat - flat @ fitted @ fitted.T) ** 2).sum(axis=1)
    found = identified[0]
    # The mean of 20000 sums scatters by 0.016. Counting the five equal numbers twice would give
    # 18.33.
    assert found.expected_sum == pytest.approx(sums.mean(), abs=0.08)


def test_one_angle_determines_all_but_one_combination() -> None:
    """The printed matrices at one angle determine all parameters except for one combination.

    The combination is a factor of the pitch-rate row. It consists of the constant and the sin² part
    of the pitch inertia.
    """
    for known, unknown in itertools.permutations(published_models()):
        fitted = fit([known], VARIANTS["published"])
        # Known to 1 %: a singular value s gives the standard error 1/(s √3).
        assert np.count_nonzero(fitted.singular_values * np.sqrt(3) > 100) == len(IDENTIFIED) - 1
        model = regenerate(hfa.aircraft(parameters=fitted.parameters.values), unknown)
        computed = np.hstack([model.A, model.B])
        print_ = np.hstack([unknown.A, unknown.B])
        errors = np.abs(computed - print_).max(axis=1) / np.abs(print_).max(axis=1)
        pitch = LINEAR_STATES.index("pitch_rate")
        assert errors[pitch] > 0.1
        assert np.delete(errors, pitch).max() < 1e-5
        row = computed[pitch]
        factor = computed[pitch] @ print_[pitch] / (computed[pitch] @ computed[pitch])
        assert np.abs(factor * row - print_[pitch]).max() < 1e-5 * np.abs(print_[pitch]).max()


#: Panels of 300 lbf: Table 1 of Gibson et al. 2011 and the publicly released simulation (SimVFA).
_MASS = 300 / 32.2
RELEASED = {
    "panel_span": 80.0,
    "tail_area": 40.0,
    "boom_length": 36.0,
    "lift_slope": 2 * np.pi,
    "aileron_lift": 2.0,
    "aileron_moment": -0.25,
    "zero_lift_moment": 0.025,
    "zero_lift_drag": 0.007,
    "induced_drag": 0.07,
    "panel_mass": _MASS,
    "inertia_roll": 30 * _MASS,
    "inertia_pitch": 2 * _MASS,
    "inertia_yaw": 18 * _MASS,
    "hinge_stiffness": 4900.0,
    "hinge_damping": 2e5 * 0.707,
}
#: Density of the released simulation at 40,000 ft, relative to `hfa_model.atmosphere`.
THIN = 1 - 16.14e-6


def test_the_released_constants_lie_within_two_standard_errors(parameter_set: Any) -> None:
    """The constants of the released simulation are within two standard errors of the identified
    ones.
    """
    for name, value in RELEASED.items():
        distance = abs(getattr(parameter_set.values, name) - value)
        assert distance <= 2.0 * parameter_set.standard_errors[name], name


@pytest.mark.parametrize(("density", "half_units"), [(THIN, (0.0, 1.0)), (1.0, (100.0, 200.0))])
def test_released_constants_need_their_thinner_air(
    parameters: Parameters, density: float, half_units: tuple[float, float]
) -> None:
    """The constants of the released simulation reproduce the printed entries only in thinner air.

    The air density is that of the released simulation.
    """
    values = dict(RELEASED)
    for name in (
        "lift_slope",
        "aileron_lift",
        "aileron_moment",
        "zero_lift_moment",
        "zero_lift_drag",
    ):
        values[name] *= density
    values["induced_drag"] /= density
    aircraft = hfa.aircraft(parameters=parameters._replace(**values))
    largest = max(
        abs(entry.half_units)
        for published in published_models()
        for entry in compare(regenerate(aircraft, published), published)
    )
    assert half_units[0] < largest < half_units[1]
