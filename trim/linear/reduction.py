"""Reduction of linear models: omitted states are constant, or follow the other states without
delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError
from trim.linear.positions import positions

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel

#: Condition number, in nominal units, above which a matrix counts as singular.
_SINGULAR = 1e12


class _Kept(NamedTuple):
    """Positions of the states and outputs that a reduced model keeps.

    rows: states that are kept
    following: omitted states that follow the other states without delay
    outputs: outputs that are kept
    """

    rows: list[int]
    following: list[int]
    outputs: list[int]


Names = str | tuple[str, ...] | list[str] | None


def chosen(model: LinearModel, inputs: Names, outputs: Names) -> LinearModel:
    """Return a linear model with only the named inputs and outputs.

    inputs, outputs: a name or several; None for all

    Raises BadInputError if the model does not have such a name, or a name is repeated.
    """
    rows = positions("output", outputs, model.outputs)
    shown = replace(
        model,
        outputs=tuple(model.outputs[row] for row in rows),
        C=model.C[rows],
        D=model.D[rows],
        F=model.F[rows],
        output_offsets=model.output_offsets[rows],
    )
    return shown.select(inputs=inputs)


def reduced(
    model: LinearModel,
    states: Sequence[str] | None,
    inputs: Sequence[str] | None,
    residualize: Sequence[str],
) -> LinearModel:
    """Return a linear model with only the named states and inputs (`LinearModel.select`).

    states, inputs, residualize: as for `LinearModel.select`

    Raises BadInputError as `LinearModel.select` does.
    """
    if states is None:
        states = tuple(name for name in model.states if name not in residualize)
    rows = positions("state", states, model.states)
    columns = positions("input", inputs, model.inputs)
    following = positions("state", (*states, *residualize), model.states)[len(rows) :]
    if not rows:
        raise BadInputError(
            "residualize contains every state of the model; remove at least one state"
        )
    outputs = list(range(len(model.outputs)))
    if model.outputs == model.states:
        outputs = rows
    disturbances = list(range(len(model.disturbances)))
    kept = _Kept(rows, following, outputs)
    A, C = _reduced(model, model.A, model.C, kept, rows)
    B, D = _reduced(model, model.B, model.D, kept, columns)
    E, F = _reduced(model, model.E, model.F, kept, disturbances)
    return replace(
        model,
        A=A,
        B=B,
        C=C,
        D=D,
        E=E,
        F=F,
        states=tuple(model.states[i] for i in rows),
        inputs=tuple(model.inputs[i] for i in columns),
        outputs=tuple(model.outputs[i] for i in outputs),
        output_offsets=model.output_offsets[outputs],
    )


def _reduced(
    model: LinearModel,
    of_rates: np.ndarray,
    of_outputs: np.ndarray,
    kept: _Kept,
    columns: list[int],
) -> tuple[np.ndarray, np.ndarray]:
    """Return a pair of matrices of the reduced model: A and C, B and D, or E and F.

    The matrices include the effect of the states that follow without delay.

    model: the model with all states
    of_rates: A, B or E of this model
    of_outputs: C, D or F of this model
    kept: states and outputs that are kept
    columns: positions of the columns that are kept

    Raises BadInputError if the block of A of the following states is singular.
    """
    rows, following, outputs = kept
    rates = of_rates[:, columns]
    shown = of_outputs[np.ix_(outputs, columns)]
    if not following:
        return rates[rows], shown
    A22 = model.A[np.ix_(following, following)]
    names = [model.states[i] for i in following]
    nominal = np.array([model.model.states[name].nominal for name in names])
    if np.linalg.cond(A22 * nominal / nominal[:, None]) > _SINGULAR:
        raise BadInputError(
            f"{', '.join(names)} cannot be residualized, because the block A22 of A for these "
            "states is singular; residualize fewer states"
        )
    followed = -np.linalg.solve(A22, rates[following])
    return (
        rates[rows] + model.A[np.ix_(rows, following)] @ followed,
        shown + model.C[np.ix_(outputs, following)] @ followed,
    )


def reduction_note(
    model: LinearModel, whole: LinearModel, residualized: tuple[str, ...] = ()
) -> str:
    """Return a note on the states that a reduced model omits, and on the change of the eigenvalues.

    The note is "" if all states are kept.

    model: the reduced model
    whole: the model with all states
    residualized: omitted states that follow the other states without delay
    """
    truncated = tuple(name for name in whole.states if name not in (*model.states, *residualized))
    clauses = []
    for names, how in (
        (truncated, "left out (truncated)"),
        (residualized, "residualized (always in its steady state)"),
    ):
        if names:
            clauses.append(f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} {how}")
    if not clauses:
        return ""
    eigenvalues = np.linalg.eigvals(whole.A)
    sizes = np.maximum(np.abs(eigenvalues), 1e-12)
    apart = [np.min(np.abs(value - eigenvalues) / sizes) for value in np.linalg.eigvals(model.A)]
    advice = "" if residualized else " (--residualize STATES keeps the steady effect of states)"
    return (
        f"{'; '.join(clauses)}; the eigenvalues differ by up to {100 * float(max(apart)):.2g} %"
        f" from the eigenvalues with all {len(whole.states)} states{advice}"
    )
