"""Identification of the aircraft from the printed matrices by weighted least squares.

The unknowns are the parameters. The trim inputs are not printed. They are functions of the
parameters and are computed at every step. The error of each printed entry is divided by half a
unit of its last digit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import hfa
from hfa_model.declaration import VariantEquations
from hfa_model.parameters import (
    FIELDS,
    INPUTS,
    LINEAR_ROWS,
    LINEAR_STATES,
    Input,
    Parameters,
    ParameterSet,
    save_parameters,
)
from hfa_model.published import PublishedModel, published_models
from hfa_model.variants import Newton, Published, Variant
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table
from trim.hfa.level_flight import level_flight
from trim.hfa.printed import (
    EntryRow,
    compare,
    entries_at,
    entries_records,
    entries_table,
)
from trim.linear.linearize import level_model
from trim.point.halving import newton
from trim.point.system import TrimSystem


class Assumption(NamedTuple):
    """Value of a parameter that the fit does not change, with its source and the reason."""

    value: float
    source: str
    reason: str


#: Parameters not determined by the printed matrices.
ASSUMED: dict[str, Assumption] = {
    "chord": Assumption(
        8.0,
        "assumed",
        "the printed matrices determine area times coefficient only; Gibson et al. 2011, Table"
        " 1, has a chord of 8 ft",
    ),
    "thrust_per_throttle": Assumption(
        1.0,
        "assumed",
        "the printed matrices determine forces per mass; counting throttle in lbf of total"
        " thrust fixes the mass scale",
    ),
    "gravity": Assumption(32.2, "print", "A(speed, pitch) is printed as -32.2"),
}
IDENTIFIED: tuple[str, ...] = tuple(name for name in Parameters._fields if name not in ASSUMED)
# Rough guess: a 200 ft flying wing of 1000 lbf by textbook formulas, which is deliberately not the
# solution.
_MASS = 1000.0 / 3 / 32.2
_SPAN = 70.0
_CHORD = 8.0
ROUGH: dict[str, float] = {
    "panel_mass": _MASS,
    "panel_span": _SPAN,
    "tail_area": 0.05 * _SPAN * _CHORD,
    "boom_length": 3 * _CHORD,
    "inertia_roll": _MASS * _SPAN**2 / 12,  # uniform rod
    "inertia_pitch": _MASS * _CHORD**2 / 12,  # uniform plate
    "inertia_yaw": _MASS * (_SPAN**2 + _CHORD**2) / 12,
    "lift_slope": 5.5,
    "aileron_lift": 2.5,
    "aileron_moment": -0.4,
    "zero_lift_moment": 0.01,
    "zero_lift_drag": 0.01,
    "induced_drag": 0.05,
    "hinge_stiffness": 1.0e4,
    "hinge_damping": 1.0e5,
}
_FREE_INPUTS = tuple(name for name in INPUTS if name != "aileron_center")
_ROUGH_INPUTS = np.array([40.0, 0.0, 0.0, 0.0])
#: Dynamics that fit the print converge in a few hundred steps. Others would continue forever.
_MAX_EVALUATIONS = 500
#: Number of random initial guesses, and the standard deviation of their logarithms.
STARTS = 8
_START_SPREAD = 0.3


def _with_newtons(method: str) -> Variant:
    """Return the published dynamics with one method of the `newton` dynamics."""
    changed: type[Published] = type(
        f"PublishedWith_{method}", (Published,), {method: getattr(Newton, method)}
    )
    return changed()


#: The published dynamics with one method replaced by Newton's, and with all of them replaced.
ALTERNATIVES: tuple[tuple[str, Variant], ...] = (
    ("outer lever (s/6) sin η", _with_newtons("outer_lever")),
    ("outer section moment times cos η", _with_newtons("section_projection")),
    ("hinge coupling of Newton", _with_newtons("hinge_coupling")),
    ("hinge inertia of Newton", _with_newtons("hinge_inertia")),
    ("all four: newton", Newton()),
)


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of one least-squares fit.

    parameters: fitted parameters, with sources and covariance
    inputs: fitted trim inputs, one `Input` for each printed dihedral angle
    sum_of_squares: Σ (difference / half unit)² over the printed entries
    expected_sum: mean sum of squares due to rounding alone, trace((I - H) C). C is the covariance
        of the rounding errors, and H is the projection onto the range of the weighted Jacobian.
    entries: number of entries that depend on a parameter
    largest: largest |difference| / half unit
    singular_values: singular values of the weighted Jacobian with respect to relative parameters
    directions: right singular vectors, one in each row
    """

    parameters: ParameterSet
    inputs: tuple[Input, ...]
    sum_of_squares: float
    expected_sum: float
    entries: int
    largest: float
    singular_values: np.ndarray
    directions: np.ndarray

    def save(self, path: Path) -> None:
        """Write the parameters to a parameter file."""
        header = (
            "The aircraft behind the printed matrices. Written by `python -m"
            f" studies.identification`; do not edit.\nSum of squares {self.sum_of_squares:.2f} half"
            f" units^2 over {self.entries} printed entries (rounding alone gives"
            f" {self.expected_sum:.1f} on average).\nThe covariance is that of small errors: sample"
            " it in the logarithms of the parameters, as\nhfa_model.sample_parameters does."
            " Sampled as a plain Gaussian it spreads entries of A up to 4.8 times too far."
        )
        save_parameters(self.parameters, path, header)


class Structure(NamedTuple):
    """Alternative dynamics, and their best fit to the printed matrices.

    description: description of the dynamics
    sum_of_squares, largest: as in `Fit`
    """

    description: str
    sum_of_squares: float
    largest: float


@dataclass(frozen=True, repr=False)
class Identification(Reported):
    """The fit of the published dynamics, with evidence for it.

    fit: the best fit
    starts: sum of squares reached from each initial guess
    tables: printed dihedral angle (deg) -> compared entries
    structures: fits of alternative dynamics
    """

    fit: Fit
    starts: list[float]
    tables: dict[float, tuple[EntryRow, ...]]
    structures: tuple[Structure, ...]

    def report(self) -> Report:
        """Return a report of the parameters, entries, singular values and alternative dynamics."""
        fit = self.fit
        parameters = self.fit.parameters
        combinations = []
        for value, direction in zip(fit.singular_values, fit.directions, strict=True):
            largest = np.argsort(-np.abs(direction))[:4]
            words = "  ".join(
                f"{direction[i]:+.2f} {IDENTIFIED[i]}" for i in largest if abs(direction[i]) > 0.1
            )
            # Rounding errors have the standard deviation 1/√3 half units.
            combinations.append((f"{value:.3g}", f"{100 / (value * np.sqrt(3)):.2g} %", words))
        tried = [
            (each.description, f"{each.sum_of_squares:.4g}", f"{each.largest:.4g}")
            for each in self.structures
        ]
        return Report(
            title=(
                f"{len(IDENTIFIED)} parameters identified from {fit.entries} printed entries;"
                f" {_agreeing(self.starts)} of {len(self.starts)} starts agree\nSum of squares"
                f" {fit.sum_of_squares:.2f} half units² (rounding alone gives"
                f" {fit.expected_sum:.1f} on average), largest difference {fit.largest:.2f} half"
                " units"
            ),
            parts=(
                parameters.table(),
                entries_table(
                    "entry, as printed",
                    {f"{angle:g} deg ": each for angle, each in self.tables.items()},
                ),
                (
                    Table(
                        ("singular value", "known to", "combination of relative parameters"),
                        combinations,
                    ),
                    (
                        "Not determined by the print, in combination only: all masses, inertias,"
                        " hinge constants and force coefficients together\n(fixed by"
                        " thrust_per_throttle), and chord times the coefficients (fixed by chord)."
                    ),
                ),
                Table(("structure", "sum of squares", "largest, half units"), tried),
            ),
            data={
                "schema": "hfa.identification/1",
                "parameters": {
                    name: {
                        "value": value,
                        "unit": getattr(FIELDS, name).unit,
                        "source": parameters.sources[name],
                        "standard_error": parameters.standard_errors.get(name),
                    }
                    for name, value in parameters.values._asdict().items()
                },
                "sum_of_squares": fit.sum_of_squares,
                "expected_sum": fit.expected_sum,
                "half_units_of_largest": fit.largest,
                "starts": self.starts,
                "singular_values": fit.singular_values.tolist(),
                "trim_inputs": {
                    str(angle): inputs._asdict()
                    for angle, inputs in zip(self.tables, fit.inputs, strict=True)
                },
                "entries": [
                    {"dihedral_deg": angle, **entry.to_dict()}
                    for angle, each in self.tables.items()
                    for entry in each
                ],
                "structures": [each._asdict() for each in self.structures],
            },
            records=entries_records(self.tables),
        )


def run_identification(seed: int = 0, progress: Progress | None = None) -> Identification:
    """Identify the parameters, fit alternative dynamics, and return all results.

    The computation takes a few seconds.

    seed: seed of the initial guesses
    progress: called with (finished alternatives, all alternatives)
    """
    best, starts = identify(seed)
    aircraft = hfa.aircraft(Published(), best.parameters.values)
    rng = np.random.default_rng(seed)
    tables = {
        model.dihedral_deg: compare(level_model(aircraft, model.dihedral), model)
        for model in published_models()
    }
    structures = [Structure("published", best.sum_of_squares, best.largest)]
    # Several initial guesses, including the published optimum, to favor the alternative.
    near = np.log([abs(getattr(best.parameters.values, name) / ROUGH[name]) for name in IDENTIFIED])
    for done, (description, variant) in enumerate(ALTERNATIVES, start=1):
        noises = near, None, rng.normal(size=near.size) / 3
        fits = [fit(published_models(), variant, noise=noise) for noise in noises]
        closest = min(fits, key=lambda one: one.sum_of_squares)
        structures.append(Structure(description, closest.sum_of_squares, closest.largest))
        if progress is not None:
            progress(done, len(ALTERNATIVES))
    return Identification(best, starts, tables, tuple(structures))


def _agreeing(sums: Sequence[float]) -> int:
    """Return the number of initial guesses from which the smallest sum of squares is reached."""
    return sum(value < min(sums) * (1 + 1e-6) + 1e-9 for value in sums)


def identify(seed: int = 0) -> tuple[Fit, list[float]]:
    """Fit the published dynamics to both printed pairs from `STARTS` random initial guesses.

    Return (best fit, sum of squares reached from each guess). Raises NoSolutionError if fewer than
    half of the guesses lead to the best fit.
    """
    noises = np.random.default_rng(seed).normal(size=(STARTS, len(IDENTIFIED))) * _START_SPREAD
    noises[0] = 0.0
    fits = [fit(published_models(), Published(), noise=noise) for noise in noises]
    sums = [one.sum_of_squares for one in fits]
    if 2 * _agreeing(sums) < STARTS:
        raise NoSolutionError(
            f"only {_agreeing(sums)} of {STARTS} starts of the identification agree; try another"
            " --seed"
        )
    return fits[int(np.argmin(sums))], sums


def fit(
    models: Sequence[PublishedModel], structure: Variant, *, noise: np.ndarray | None = None
) -> Fit:
    """Return the parameters p that fit printed entries of A and B by weighted least squares.

        Σ ((A(p, U(p)) - A_print)/h)² + ((B(p, U(p)) - B_print)/h)²

    U(p) are the trim inputs, for which f(p, U(p)) = 0, and h is half a unit of the last printed
    digit. The method is Levenberg-Marquardt with exact Jacobians, which include the change of U(p).

    models: printed pairs to fit
    structure: the dynamics
    noise: added to the logarithm of the rough initial guess, or None for 0
    """
    from scipy.optimize import least_squares

    problem = _Problem(models, structure)
    guess = np.array(list(ROUGH.values()))  # the unknowns y are θ relative to it
    start = np.exp(noise) if noise is not None else np.ones(len(guess))
    tight: Any = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": _MAX_EVALUATIONS}
    solution = least_squares(
        lambda y: problem.errors(y * guess).values,
        start,
        lambda y: problem.errors(y * guess).jacobian * guess,
        method="lm",
        **tight,
    )
    return _as_fit(problem, np.asarray(solution.x) * guess)


class _Errors(NamedTuple):
    """Errors (entry - print) / half unit, (N,), and their Jacobian with respect to θ, (N, k)."""

    values: np.ndarray
    jacobian: np.ndarray


class _Problem:
    """Weighted errors of the printed entries and their Jacobian, as functions of parameters θ.

    θ are the values of `IDENTIFIED`, (k,).
    """

    def __init__(self, models: Sequence[PublishedModel], structure: Variant) -> None:
        own = replace(hfa.aircraft(), equations=VariantEquations(structure))
        self._layout = own.layout
        self._held = [level_flight(model.dihedral).imposed for model in models]
        self._dihedrals = np.array([model.dihedral for model in models])
        self._system = TrimSystem(own, level_flight(models[0].dihedral), ("dihedral",))
        self._free = [own.variables.index(name) for name in _FREE_INPUTS]
        # The rows of pitch and dihedral are equal for every aircraft.
        moved = [i for i, name in enumerate(LINEAR_STATES) if name not in ("pitch", "dihedral")]
        self._rows = [LINEAR_ROWS[i] for i in moved]
        #: Places of the other rows among all entries of [A, B], counted column by column.
        self._entries = [
            i + len(LINEAR_STATES) * j for j in range(len(LINEAR_STATES + INPUTS)) for i in moved
        ]
        self._printed = [np.hstack([m.A, m.B]).ravel("F")[self._entries] for m in models]
        half_units = [np.hstack([m.half_unit_A, m.half_unit_B]).ravel("F") for m in models]
        self._half_units = [each[self._entries] for each in half_units]
        #: All parameters: the assumed ones, and θ as soon as `trim_inputs` has written it.
        self._p = np.array(
            [ASSUMED[name].value if name in ASSUMED else 0.0 for name in Parameters._fields]
        )
        self._known = [Parameters._fields.index(name) for name in IDENTIFIED]
        self._last: tuple[np.ndarray, _Errors] | None = None

    def trim_inputs(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return the free trim inputs for each printed matrix pair, by Newton's method."""
        self._p[self._known] = theta  # for `errors`, too
        values = dict(zip(Parameters._fields, self._p, strict=True))
        columns = {name: np.full(len(self._held), value) for name, value in values.items()}
        columns["dihedral"] = self._dihedrals
        constants = self._system.constants(len(self._held), columns)
        start = np.tile(_ROUGH_INPUTS / self._system.scales, (len(self._held), 1))
        z, _ = newton(self._system, start, constants)
        return list(z * self._system.scales)

    def errors(self, theta: np.ndarray) -> _Errors:
        """Return the errors of the printed entries at θ, which are kept for the next call."""
        if self._last is None or not np.array_equal(self._last[0], theta):
            values = []
            jacobians = []
            for held, inputs, printed, half_units in zip(
                self._held, self.trim_inputs(theta), self._printed, self._half_units, strict=True
            ):
                v = np.array([held.get(name, 0.0) for name in hfa.aircraft().variables])
                v[self._free] = inputs
                entries, by_p = entries_at(self._layout, v, self._p, self._free, self._rows)
                values.append((entries[self._entries] - printed) / half_units)
                jacobians.append(by_p[np.ix_(self._entries, self._known)] / half_units[:, None])
            self._last = theta.copy(), _Errors(np.concatenate(values), np.vstack(jacobians))
        return self._last[1]


def _as_fit(problem: _Problem, theta: np.ndarray) -> Fit:
    """Return the fit whose parameters are θ, with its covariance, singular values and errors."""
    errors, jacobian = problem.errors(theta)
    relative = jacobian * np.abs(theta)  # derivatives by relative parameters
    fitted, singular_values, directions = np.linalg.svd(relative, full_matrices=False)
    # The sign of a direction is arbitrary. Its largest component is made positive, so that the
    # result does not depend on the machine.
    largest = np.abs(directions).argmax(axis=1)
    directions *= np.sign(directions[np.arange(len(directions)), largest])[:, None]
    rounding = _rounding_covariance(relative)
    estimator = np.linalg.inv(relative.T @ relative) @ relative.T  # of relative parameters
    sizes = np.abs(theta)
    covariance = estimator @ rounding @ estimator.T * np.outer(sizes, sizes)
    # Structural zeros depend on no parameter: other entries move by more than .001 half units.
    depends = np.abs(relative).max(axis=1) > 1e-3
    values = {name: assumed.value for name, assumed in ASSUMED.items()}
    values |= dict(zip(IDENTIFIED, theta.tolist(), strict=True))
    parameters = ParameterSet(
        values=Parameters(**values),
        sources={
            name: ASSUMED[name].source if name in ASSUMED else "identified"
            for name in Parameters._fields
        },
        notes={name: assumed.reason for name, assumed in ASSUMED.items()},
        covariance=(covariance + covariance.T) / 2,
    )
    return Fit(
        parameters=parameters,
        inputs=tuple(
            Input(aileron_center=0.0, **dict(zip(_FREE_INPUTS, inputs.tolist(), strict=True)))
            for inputs in problem.trim_inputs(theta)
        ),
        sum_of_squares=float(errors @ errors),
        # Structural zeros have no rounding error.
        expected_sum=float(
            np.trace(rounding[depends][:, depends]) - np.trace(fitted.T @ rounding @ fitted)
        ),
        entries=int(np.count_nonzero(depends)),
        largest=float(np.abs(errors).max()),
        singular_values=singular_values,
        directions=directions,
    )


def _rounding_covariance(relative: np.ndarray) -> np.ndarray:
    """Return the covariance (N, N) of the rounding errors of the printed entries, in half units².

    The rounding error of an entry, uniform within ±h, has the variance h²/3. Entries with equal
    derivatives are the same number printed at both angles, for example B(speed, throttle). Their
    rounding errors are equal, and the second entry contains no further information.

    relative: derivatives of the entries, in half units, by relative parameters, (N, k)
    """
    distance = np.abs(relative[:, None, :] - relative[None, :, :]).max(axis=2)  # of two entries
    # Structural zeros, with derivatives of 0, have no equal entries.
    same = distance < 1e-6 * np.abs(relative).max(axis=1)
    return np.where(same | np.eye(len(relative), dtype=bool), 1 / 3, 0.0)
