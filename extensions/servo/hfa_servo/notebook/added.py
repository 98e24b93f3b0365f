"""Methods that are added to results, for conversion to tables, files and pictures of other
packages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.critic import Critic, from_gain
from controller.game.linear_game import game
from controller.game.training_run import TrainingRun
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from controller.riccati.loop_margins import loop_margins, named_margins
from hfa_aircraft.model import Model
from hfa_servo.notebook.frames import entries_frame
from hfa_servo.notebook.of_control import of_control
from hfa_support.errors import BadInputError, numbers_in
from hfa_support.reporting.by_name import ByName
from hfa_support.reporting.report import Reported
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.sweeps.sweep import Sweep
from verification.critic.verdict import Verdict

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes


def _to_json(value: Any) -> Callable[..., Any] | None:
    """Return the method `to_json` of a result, or None if the value is not a result.

    The method returns JSON text. If a path is given, the method writes a file instead, in the
    format of the suffix.
    """
    if not isinstance(value, Reported):
        return None

    def to_json(path: str | Path | None = None) -> Any:
        return value.report().json() if path is None else value.save(Path(path))

    return to_json


def _to_series(value: Any) -> Callable[[], Any] | None:
    """Return the method `to_series` of an operating point, or None for another value.

    The method returns the values by name as a `pandas.Series`.
    """
    if not isinstance(value, OperatingPoint):
        return None

    def to_series() -> Any:
        import pandas

        return pandas.Series(dict(value), name=value.model.title)

    return to_series


def _to_scipy(value: Any) -> Callable[[], Any] | None:
    """Return the method `to_scipy` of a linear model, or None for another value.

    The method returns SciPy's `StateSpace`.
    """
    if not isinstance(value, LinearModel):
        return None

    def to_scipy() -> Any:
        from scipy.signal import StateSpace

        return StateSpace(*value)

    return to_scipy


def _plot(value: Any) -> Callable[[], Any] | None:
    """Return the method `plot` of a result, or None for a result without a picture.

    The method draws

    - the poles of a solution,
    - the weights of a training run over time,
    - the first picture in the report of another result.

    Raises AttributeError for a Model.
    """
    if isinstance(value, Model):
        raise AttributeError("a Model has no plot; write model.trim().plot()")
    if isinstance(value, Solution):
        return partial(_draw_poles, value)
    if isinstance(value, TrainingRun):
        return partial(_draw_weights, value)
    picture = next(value.report().pictures(), None) if isinstance(value, Reported) else None
    return None if picture is None else picture.draw


def _draw_poles(solution: Solution) -> Axes:
    """Draw the poles of A - B K in a new pyplot figure and return its Axes."""
    import control
    from matplotlib import pyplot

    axes: Axes = pyplot.figure(layout="constrained").subplots()
    control.pole_zero_plot(solution.closed_loop, ax=axes)
    axes.set_title(f"{solution.names.origin}: poles of A - B K, 1/s")
    return axes


def _draw_weights(run: TrainingRun) -> Axes:
    """Draw the weights of a training run over time in a new pyplot figure and return its Axes."""
    from matplotlib import pyplot

    axes: Axes = pyplot.figure(layout="constrained").subplots()
    axes.plot(run.time, run.weights)
    axes.set_xlabel(f"time, {run.clock}")
    axes.set_ylabel("weights W")
    axes.set_title(f"law {run.law}, {run.names.origin}: {run.outcome}")
    return axes


def _replace(value: Any) -> Callable[..., Any] | None:
    """Return the method `replace` of a game, model or trim condition, or None for another value.

    The method returns a copy with changed fields.
    """
    has_fields = isinstance(value, (Game, Model, TrimCondition))
    return partial(replace, value) if has_fields else None


def _history(value: Any) -> Any:
    """Return the attribute `history` of a training run, a pandas table over time.

    Returns None if the value is not a training run.
    """
    return value.to_pandas() if isinstance(value, TrainingRun) else None


def _to_pandas(value: Any) -> Callable[[], Any] | None:
    """Return the method `to_pandas` of a list of named entries, such as modes, or None for another
    value.

    The method returns a table with one row for each entry.
    """
    return partial(entries_frame, value) if isinstance(value, ByName) else None


def _html_table(value: Any) -> Callable[[], str] | None:
    """Return the method that displays named entries as a table in a notebook.

    Returns None for another value, for an empty list, or if pandas is not installed.
    """
    is_shown = isinstance(value, ByName) and len(value) > 0 and find_spec("pandas") is not None
    return (lambda: entries_frame(value).to_html()) if is_shown else None


def _outputs(value: Any) -> dict[str, float] | None:
    """Return the values of the outputs of an operating point by name, or None for another value."""
    is_point = isinstance(value, OperatingPoint)
    return {name: value[name] for name in value.model.outputs} if is_point else None


def _linearize(value: Any) -> Callable[..., LinearModel] | None:
    """Return the method `linearize` of a linear model, or None for another value.

    Without options, the method returns the linear model itself. With options, it linearizes again
    at the same operating point.
    """
    if not isinstance(value, LinearModel):
        return None

    def linearize(**options: Any) -> LinearModel:
        return value.point.linearize(**options) if options else value

    return linearize


def _root_locus(value: Any) -> Callable[[], Any] | None:
    """Return the method `root_locus` of a sweep, which draws the sweep, or None for another
    value.
    """
    return value.plot if isinstance(value, Sweep) else None


def _game_of(linear: LinearModel) -> Game:
    """Return a game on a linear model, for functions that use only A and B of the game."""
    n, m = linear.B.shape
    return game(linear, np.eye(n), np.eye(m), E=np.eye(n))


def _policy_values(value: Any) -> Callable[[Any], np.ndarray] | None:
    """Return the method `u` of a critic, or None for another value.

    The method returns the inputs u(z), (m,) or (N, m), at deviations z of the state, (n,) or
    (N, n). It raises BadInputError for another shape.
    """
    if not isinstance(value, Critic):
        return None

    def u(z: Any) -> np.ndarray:
        rows = numbers_in("z", z)
        n = value.K.shape[1]
        if rows.ndim not in (1, 2) or rows.shape[-1] != n:
            raise BadInputError(f"z has shape {rows.shape}; give ({n},) or (N, {n})")
        columns = value.policy(np.atleast_2d(rows).T).full()
        return columns.T.reshape(*rows.shape[:-1], -1)

    return u


def _closed_loop(value: Any) -> Callable[[Any], control.StateSpace] | None:
    """Return the method `closed_loop` of a linear model, or None for another value.

    Called with a gain K, the method returns z' = (A - B K) z + B v as a system of python-control.
    """
    if not isinstance(value, LinearModel):
        return None

    def closed_loop(K: Any) -> control.StateSpace:
        gain = from_gain(_game_of(value), getattr(K, "K", K)).K
        changes = {"A": value.A - value.B @ gain, "C": value.C - value.D @ gain}
        return replace(value, **changes).to_control()

    return closed_loop


def _margins(value: Any) -> Callable[..., Any] | None:
    """Return the method `margins` of a linear model, or None for another value.

    - Called with a gain K, the method returns the margins of the loop at each input.
    - Otherwise it returns python-control's margins of a single loop.
    """
    if not isinstance(value, LinearModel):
        return None

    def margins(*arguments: Any, **named: Any) -> Any:
        given = named.get("K", *arguments[:1]) if len(arguments) + len(named) == 1 else None
        gain = getattr(given, "K", given)
        if gain is None or np.ndim(gain) != 2:
            return of_control(value, "margin")(*arguments, **named)
        plant = _game_of(value)
        return named_margins(value.inputs, loop_margins(plant, from_gain(plant, gain).K))

    return margins


#: Name of an added attribute -> function from a result to its value, or None.
ADDED: dict[str, Callable[[Any], Any]] = {
    "_repr_html_": _html_table,
    "certified": lambda value: value.certificate.ok if isinstance(value, Solution) else None,
    "closed_loop": _closed_loop,
    "df": lambda value: value.to_pandas() if hasattr(value, "to_pandas") else None,
    "history": _history,
    "linearize": _linearize,
    "margin": _margins,
    "margins": _margins,
    "outputs": _outputs,
    "plot": _plot,
    "poles": lambda value: value.eigenvalues if isinstance(value, Sweep) else None,
    "replace": _replace,
    "root_locus": _root_locus,
    "to_json": _to_json,
    "to_pandas": _to_pandas,
    "to_scipy": _to_scipy,
    "to_series": _to_series,
    "u": _policy_values,
    "verdict": lambda value: value.grade_text() if isinstance(value, Verdict) else None,
}
