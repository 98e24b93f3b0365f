"""Find the aircraft behind the printed matrices: weighted least squares over both pairs and their trims.

Unknown are the parameters; the trim inputs, which the paper does not print, follow from them and are solved for at
every step. Each printed entry weighs with half a unit of its last digit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hfa_model.aircraft import HFA, Aircraft, Equations
from hfa_model.parameters import Parameters, ParameterSet, save_parameters
from hfa_model.printed_matrices import PublishedModel, published_models
from hfa_model.variants import Newton, Published, Variant
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, Input
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.progress import Progress
from trim.identification.identification_result import ASSUMED, IDENTIFIED, Fit, Identification, LeftOut, Structure
from trim.linear.compare import EntryRow, compare, regenerate
from trim.linear.entry_bands import entries_at
from trim.point.condition import level_flight
from trim.sweeps.points import newton_functions


def _with_newtons(method: str) -> Variant:
    """The published structure with one method of Newton's."""
    changed: type[Published] = type(f"PublishedWith_{method}", (Published,), {method: getattr(Newton, method)})
    return changed()


#: The published structure with each of its departures from Newton undone, one at a time, then all.
ALTERNATIVES: tuple[tuple[str, Variant], ...] = (
    ("outer lever (s/6) sin η", _with_newtons("outer_lever")),
    ("outer section moment times cos η", _with_newtons("section_projection")),
    ("hinge coupling of Newton", _with_newtons("hinge_coupling")),
    ("hinge inertia of Newton", _with_newtons("hinge_inertia")),
    ("all four: newton", Newton()),
)


def run_identification(seed: int = 0, progress: Progress | None = None) -> Identification:
    """Identify, then collect the evidence; a few seconds. progress: called with (stages done, stages in all)."""
    stages = len(ALTERNATIVES) + 2

    def done(stage: int) -> None:
        if progress is not None:
            progress(stage, stages)

    best, starts = identify(seed)
    done(1)
    aircraft = Aircraft(best.parameters.values, Published())
    tables = {model.dihedral_deg: compare(regenerate(aircraft, model), model) for model in published_models()}
    return Identification(best, starts, tables, _structures(best, seed, done), _left_out(done))


def save_fit(fitted: Fit, path: Path) -> None:
    """Write one fit as a parameters file."""
    header = (
        "The aircraft behind the printed matrices. Written by `hfa identify`; do not edit.\n"
        f"Sum of squares {fitted.sum_of_squares:.2f} half units^2 over {fitted.entries} printed entries "
        f"(rounding alone gives {fitted.expected_sum:.1f} on average).\n"
        "The covariance is that of small errors: sample it in the logarithms of the parameters, as\n"
        "hfa_model.sample_parameters does. Sampled as a plain Gaussian it spreads entries of A up to 4.8 times too far."
    )
    save_parameters(fitted.parameters, path, header)


def _structures(best: Fit, seed: int, done: Callable[[int], None]) -> tuple[Structure, ...]:
    rng = np.random.default_rng(seed)
    rows = [Structure("published", best.sum_of_squares, best.largest)]
    for index, (description, variant) in enumerate(ALTERNATIVES):
        # From the published optimum and from rough guesses: the alternative gets its best chance.
        near = np.log([abs(getattr(best.parameters.values, name) / ROUGH[name]) for name in IDENTIFIED])
        tries = [
            fit(published_models(), variant, noise=noise) for noise in (near, None, rng.normal(size=near.size) / 3)
        ]
        chosen = min(tries, key=lambda one: one.sum_of_squares)
        rows.append(Structure(description, chosen.sum_of_squares, chosen.largest))
        done(2 + index)
    return tuple(rows)


def _left_out(done: Callable[[int], None]) -> tuple[LeftOut, ...]:
    rows = []
    first, second = published_models()
    for known, unknown in ((first, second), (second, first)):
        fitted = fit([known], Published(), prior=True)
        table = compare(regenerate(Aircraft(fitted.parameters.values, Published()), unknown), unknown)
        rows_of = {name: [entry for entry in table if entry.row == name] for name in LINEAR_STATES}
        errors = {name: _row_error(entries, 1.0) for name, entries in rows_of.items()}
        pitch = rows_of["pitch_rate"]
        factor = sum(e.computed * e.printed for e in pitch) / sum(e.computed**2 for e in pitch)
        # A direction is determined when the data know it to 1 % (singular value s: standard error 1/(s √3)).
        determined = int(np.count_nonzero(fitted.singular_values * np.sqrt(3) > 100))
        shape_error = _row_error(pitch, factor)
        rows.append(LeftOut(known.dihedral_deg, unknown.dihedral_deg, determined, errors, shape_error))
    done(len(ALTERNATIVES) + 2)
    return tuple(rows)


def _row_error(entries: list[EntryRow], factor: float) -> float:
    size = max(abs(entry.printed) for entry in entries)
    return max(abs(factor * entry.computed - entry.printed) for entry in entries) / size


# Where the search begins: a 200 ft flying wing of 1000 lbf, from textbook formulas, deliberately not the answer.
_MASS, _SPAN, _CHORD = 1000.0 / 3 / 32.2, 70.0, 8.0
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
_TRIM_STEPS = 30
#: A structure that can reach the print does so in a few hundred steps; one that cannot would creep for ever.
_MAX_EVALUATIONS = 500
#: Seeded rough guesses, and the standard deviation of their logarithms.
STARTS, _START_SPREAD = 8, 0.3
#: Trust in the rough guess where one printed angle alone leaves a combination open (standard deviation of the log).
_PRIOR_SPREAD = 0.3


def identify(seed: int = 0) -> tuple[Fit, list[float]]:
    """The published structure fitted to both printed pairs from `STARTS` seeded rough guesses.

    Returns the best fit and the sum of squares that each start reached. NoSolutionError when fewer than half
    of the starts agree on the best.
    """
    rng = np.random.default_rng(seed)
    fits = []
    for index in range(STARTS):
        noise = rng.normal(size=len(IDENTIFIED)) * _START_SPREAD * (index > 0)
        fits.append(fit(published_models(), Published(), noise=noise))
    sums = [one.sum_of_squares for one in fits]
    best = fits[int(np.argmin(sums))]
    agreeing = sum(value < best.sum_of_squares * (1 + 1e-6) + 1e-9 for value in sums)
    if 2 * agreeing < STARTS:
        raise NoSolutionError(f"only {agreeing} of {STARTS} starts of the identification agree; try another --seed")
    return best, sums


def fit(
    models: Sequence[PublishedModel],
    structure: Variant,
    *,
    noise: np.ndarray | None = None,
    prior: bool = False,
) -> Fit:
    """min_p Σ ((A(p, U(p)) - A_print)/h)² + ((B(p, U(p)) - B_print)/h)²,  U(p) the trim inputs: f(p, U(p)) = 0.

    models: printed pairs to fit. structure: the equations. noise: added to the log of the rough guess. prior: weigh
    the rough guess in, weakly, for data that leave combinations open. Solved by Levenberg-Marquardt on exact
    Jacobians, the inputs eliminated by the implicit function theorem (variable projection).
    """
    from scipy.optimize import least_squares

    problem = _Problem(models, structure)
    guess = np.array(list(ROUGH.values()))
    weights = np.eye(len(guess)) / _PRIOR_SPREAD if prior else np.zeros((0, len(guess)))

    def residual(y: np.ndarray) -> np.ndarray:
        return np.concatenate([problem.entries(y * guess)[0], weights @ (y - 1)])

    def jacobian(y: np.ndarray) -> np.ndarray:
        return np.vstack([problem.entries(y * guess)[1] * guess, weights])

    start = np.exp(noise) if noise is not None else np.ones(len(guess))
    solution = least_squares(
        residual, start, jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=_MAX_EVALUATIONS
    )
    return _as_fit(problem, np.asarray(solution.x) * guess, prior)


class _Problem:
    """The weighted entries of the printed pairs and their Jacobian as functions of the unknown parameters θ."""

    def __init__(self, models: Sequence[PublishedModel], structure: Variant) -> None:
        self._layout, names = replace(HFA, equations=Equations(structure)).layout, HFA.variables
        self._held = [level_flight(model.dihedral).imposed for model in models]
        given, rates = tuple(self._held[0]), tuple((name, 0.0, HFA.rate_scale(name)) for name in HFA.steady)
        functions = newton_functions(self._layout, given, _FREE_INPUTS, rates)
        assert functions is not None
        self._step, self._free = BoundFunction(functions[0]), [names.index(name) for name in _FREE_INPUTS]
        #: The rows θ' = q and η' = η' are the same for every aircraft.
        moved = [i for i, name in enumerate(LINEAR_STATES) if name not in ("pitch", "dihedral")]
        self._rows = [LINEAR_ROWS[i] for i in moved]
        self._entries = [i + len(LINEAR_STATES) * j for j in range(len(LINEAR_STATES + INPUTS)) for i in moved]
        printed = [np.hstack(each).ravel("F") for m in models for each in ((m.A, m.B), (m.half_unit_A, m.half_unit_B))]
        self._printed = [each[self._entries] for each in printed]
        self._p = np.array([ASSUMED.get(name, (0.0,))[0] for name in Parameters._fields])
        self._known = [Parameters._fields.index(name) for name in IDENTIFIED]
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None

    def trim_inputs(self, theta: np.ndarray) -> list[np.ndarray]:
        """The free inputs that balance each printed condition, by Newton's method (the loads are nearly affine)."""
        self._p[self._known] = theta
        return [self._trimmed(list(held.values())) for held in self._held]

    def _trimmed(self, held: list[float]) -> np.ndarray:
        inputs = best = _ROUGH_INPUTS
        smallest, step = np.inf, self._step
        step.inputs[0][:], step.inputs[2][:] = held, self._p
        for _ in range(_TRIM_STEPS):
            step.inputs[1][:] = inputs
            step()
            if not step.results[1][0] < smallest:
                break
            best, smallest, inputs = inputs, step.results[1][0], step.results[0].copy()
        return best

    def entries(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(entry - print) / half unit of every printed entry that the structure can move, and its Jacobian with the
        trim's share in it.

        The last answer is kept: the solver asks for values and Jacobian one after the other.
        """
        if self._last is None or not np.array_equal(self._last[0], theta):
            values, jacobians = [], []
            for k, inputs in enumerate(self.trim_inputs(theta)):
                v = np.array([self._held[k].get(name, 0.0) for name in HFA.variables])
                v[self._free] = inputs
                found, by_p = entries_at(self._layout, v, self._p, self._free, self._rows)
                printed, half = self._printed[2 * k : 2 * k + 2]
                values.append((found[self._entries] - printed) / half)
                jacobians.append(by_p[np.ix_(self._entries, self._known)] / half[:, None])
            self._last = theta.copy(), (np.concatenate(values), np.vstack(jacobians))
        return self._last[1]


def _as_fit(problem: _Problem, theta: np.ndarray, prior: bool) -> Fit:
    printed, jacobian = problem.entries(theta)
    relative = jacobian * np.abs(theta)
    fitted, singular_values, directions = np.linalg.svd(relative, full_matrices=False)
    # A direction has no sign of its own: its largest component is made positive, on every machine alike.
    directions *= np.sign(directions[np.arange(len(directions)), np.abs(directions).argmax(axis=1)])[:, None]
    prior_information = np.eye(len(theta)) / _PRIOR_SPREAD**2 if prior else np.zeros((len(theta), len(theta)))
    inverse = np.linalg.inv(relative.T @ relative + prior_information)
    rounding = _rounding_covariance(relative)
    spread = relative.T @ rounding @ relative + prior_information / 3
    covariance = inverse @ spread @ inverse * np.outer(np.abs(theta), np.abs(theta))
    moved = np.abs(relative).max(axis=1) > 1e-3  # by some parameter, by more than rounding errors are
    values = {name: value for name, (value, _, _) in ASSUMED.items()}
    values |= dict(zip(IDENTIFIED, theta.tolist(), strict=True))
    parameters = ParameterSet(
        values=Parameters(**values),
        sources={name: ASSUMED[name][1] if name in ASSUMED else "identified" for name in Parameters._fields},
        notes={name: note for name, (_, _, note) in ASSUMED.items()},
        covariance=(covariance + covariance.T) / 2,
    )
    return Fit(
        parameters=parameters,
        inputs=tuple(
            Input(aileron_center=0.0, **dict(zip(_FREE_INPUTS, inputs.tolist(), strict=True)))
            for inputs in problem.trim_inputs(theta)
        ),
        sum_of_squares=float(printed @ printed),
        # Structural zeros (no parameter moves them) carry no rounding.
        expected_sum=float(np.trace(rounding[moved][:, moved]) - np.trace(fitted.T @ rounding @ fitted)),
        entries=int(np.count_nonzero(moved)),
        largest=float(np.abs(printed).max()),
        singular_values=singular_values,
        directions=directions,
    )


def _rounding_covariance(relative: np.ndarray) -> np.ndarray:
    """Covariance of the entries' rounding errors, in half units²: an entry rounded to a unit of 2h has h²/3.

    Entries with equal derivatives are one number printed at both angles, as B(speed, throttle) is: they were
    rounded alike, and the second of them tells nothing new.
    """
    distance = np.abs(relative[:, None, :] - relative[None, :, :]).max(axis=2)
    same = distance < 1e-6 * np.abs(relative).max(axis=1)
    return np.where(same | np.eye(len(relative), dtype=bool), 1 / 3, 0.0)
