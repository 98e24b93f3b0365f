"""Find the aircraft behind the printed matrices: weighted least squares over both pairs and their trims.

Unknown are the parameters; the trim inputs, which the paper does not print, follow from them and are solved for at
every step. Each printed entry weighs with half a unit of its last digit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

from hfa_model.aircraft import HFA, Aircraft, Equations
from hfa_model.parameters import Parameters, ParameterSet, save_parameters
from hfa_model.printed_matrices import PublishedModel, published_models
from hfa_model.variants import Newton, Published, Variant
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, STATES, Input, Quantity
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.progress import Progress
from trim.identification.identification_result import ASSUMED, IDENTIFIED, Fit, Identification, LeftOut, Structure
from trim.linear.compare import EntryRow, compare, regenerate
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
    """The weighted entries of the printed pairs and their Jacobian as functions of the unknown parameters."""

    def __init__(self, models: Sequence[PublishedModel], structure: Variant) -> None:
        theta = ca.SX.sym("theta", len(IDENTIFIED))
        known = {name: value for name, (value, _, _) in ASSUMED.items()}
        p = Parameters(**known, **dict(zip(IDENTIFIED, ca.vertsplit(theta), strict=True)))
        self._cases = [_Condition(model, theta, p, structure) for model in models]
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None

    def trim_inputs(self, theta: np.ndarray) -> list[np.ndarray]:
        """The free inputs that balance each printed condition."""
        return [case.trim_inputs(theta) for case in self._cases]

    def entries(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(entry - print) / half unit of every printed entry that the structure can move, and its Jacobian.

        The last answer is kept: the solver asks for values and Jacobian one after the other.
        """
        if self._last is None or not np.array_equal(self._last[0], theta):
            values, jacobians = zip(*(case.entries(theta) for case in self._cases), strict=True)
            self._last = theta.copy(), (np.concatenate(values), np.vstack(jacobians))
        return self._last[1]


class _Condition:
    """One printed condition as compiled functions of the parameters θ and the free inputs v."""

    def __init__(self, model: PublishedModel, theta: ca.SX, p: Parameters, variant: Variant) -> None:
        layout = replace(HFA, equations=Equations(variant)).layout
        (x, u), inputs = layout.symbols("x", "u"), ca.SX.sym("v", len(_FREE_INPUTS))
        f, _ = layout.expressions((ca.vertsplit(x), ca.vertsplit(u), list(p)), ())
        A, B = ca.jacobian(f, x)[LINEAR_ROWS, LINEAR_ROWS], ca.jacobian(f, u)[LINEAR_ROWS, :]
        # The rows θ' = q and η' = η' are the same for every aircraft.
        moved = [i for i, name in enumerate(LINEAR_STATES) if name not in ("pitch", "dihedral")]
        entries = ca.vertcat(
            *((A[i, j] - model.A[i, j]) / model.half_unit_A[i, j] for i in moved for j in range(A.shape[1])),
            *((B[i, j] - model.B[i, j]) / model.half_unit_B[i, j] for i in moved for j in range(B.shape[1])),
        )
        balance = ca.vertcat(*(f[LINEAR_ROWS[i]] for i in moved))
        flight = level_flight(model.dihedral)
        state = {**flight.imposed, "pitch": flight.imposed["alpha"] + flight.imposed["gamma"]}
        point = ca.vertcat(*(state[name] for name in STATES), *_as_input(ca.vertsplit(inputs)))
        entries, balance = (ca.substitute(part, ca.vertcat(x, u), point) for part in (entries, balance))
        given, rates = tuple(flight.imposed), tuple((name, 0.0, HFA.rate_scale(name)) for name in HFA.steady)
        functions = newton_functions(layout, given, _FREE_INPUTS, rates)
        assert functions is not None
        after, size = functions[0](ca.DM([flight.imposed[name] for name in given]), inputs, ca.vertcat(*p))
        self._step = _bound([theta, inputs], (after, size))
        by_both = [ca.jacobian(part, by) for part in (balance, entries) for by in (theta, inputs)]
        self._everything = _bound([theta, inputs], (entries, *by_both))

    def trim_inputs(self, theta: np.ndarray) -> np.ndarray:
        """v with balance(θ, v) = 0 by Newton's method (the loads are nearly affine)."""
        inputs = best = _ROUGH_INPUTS
        smallest = np.inf
        for _ in range(_TRIM_STEPS):
            after, size = self._step(theta, inputs)
            if not size.item() < smallest:
                break
            best, smallest, inputs = inputs, size.item(), after.ravel().copy()
        return best

    def entries(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The weighted entries at the trim, and their Jacobian by θ with the trim's share in it."""
        entries, balance_by_theta, balance_by_inputs, by_theta, by_inputs = self._everything(
            theta, self.trim_inputs(theta)
        )
        inputs_by_theta = -np.linalg.solve(balance_by_inputs, balance_by_theta)
        return entries.ravel().copy(), by_theta + by_inputs @ inputs_by_theta


def _bound(arguments: list[ca.SX], results: Sequence[ca.SX]) -> Callable[..., list[np.ndarray]]:
    """The results as matrices of the arguments' values; each call overwrites them."""
    bound = BoundFunction(ca.Function("printed_condition", arguments, [ca.densify(each) for each in results]))
    matrices = [flat.reshape(each.shape, order="F") for flat, each in zip(bound.results, results, strict=True)]

    def evaluate(*values: np.ndarray) -> list[np.ndarray]:
        for target, value in zip(bound.inputs, values, strict=True):
            target[:] = value
        bound()
        return matrices

    return evaluate


def _as_input(free: Sequence[Quantity]) -> Input:
    return Input(aileron_center=0.0, **dict(zip(_FREE_INPUTS, free, strict=True)))


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
    moved = _moved(relative)
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
        inputs=tuple(_as_input(inputs.tolist()) for inputs in problem.trim_inputs(theta)),
        sum_of_squares=float(printed @ printed),
        # Structural zeros (no parameter moves them) carry no rounding.
        expected_sum=float(np.trace(rounding[moved][:, moved]) - np.trace(fitted.T @ rounding @ fitted)),
        entries=int(np.count_nonzero(moved)),
        largest=float(np.abs(printed).max()),
        singular_values=singular_values,
        directions=directions,
    )


def _moved(relative: np.ndarray) -> np.ndarray:
    """Which entries some parameter moves by more than rounding errors do."""
    return np.asarray(np.abs(relative).max(axis=1) > 1e-3)


def _rounding_covariance(relative: np.ndarray) -> np.ndarray:
    """Covariance of the entries' rounding errors, in half units²: an entry rounded to a unit of 2h has h²/3.

    Entries with equal derivatives are one number printed at both angles, as B(speed, throttle) is: they were
    rounded alike, and the second of them tells nothing new.
    """
    distance = np.abs(relative[:, None, :] - relative[None, :, :]).max(axis=2)
    same = distance < 1e-6 * np.abs(relative).max(axis=1)
    return np.where(same | np.eye(len(relative), dtype=bool), 1 / 3, 0.0)
