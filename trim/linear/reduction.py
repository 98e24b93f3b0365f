"""Linear models of fewer states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hfa_support.errors import BadInputError, refuse_unknown
from trim.linear.modes import spectrum


def positions(what: str, names: Sequence[str] | None, known: tuple[str, ...]) -> list[int]:
    """Return the positions of names in a list of known names.

    what: kind of the names in messages: "state"
    names: one name or several; None for all known names
    known: the known names

    Raises BadInputError for an unknown name, and for a repeated name.
    """
    chosen = [names] if isinstance(names, str) else list(known if names is None else names)
    for index, name in enumerate(chosen):
        refuse_unknown(f"unknown {what}", name, known)
        if name in chosen[:index]:
            raise BadInputError(f"{what} {name} is named twice; remove one {name}")
    return [known.index(name) for name in chosen]


class Matrices(NamedTuple):
    """Matrices and names of x' = A x + B u + E w, y - Y0 = C x + D u + F w, as in `LinearModel`."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray
    F: np.ndarray
    output_offsets: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


def with_outputs(whole: Matrices, outputs: str | Sequence[str]) -> Matrices:
    """Return the matrices of a system with only the named outputs.

    outputs: a name or several

    Raises BadInputError if the system does not have such a name, or a name is repeated.
    """
    rows = positions("output", outputs, whole.outputs)
    return whole._replace(
        C=whole.C[rows],
        D=whole.D[rows],
        F=whole.F[rows],
        output_offsets=whole.output_offsets[rows],
        outputs=tuple(whole.outputs[row] for row in rows),
    )


def reduced(
    whole: Matrices,
    states: Sequence[str] | None,
    inputs: Sequence[str] | None,
    residualize: Sequence[str],
) -> Matrices:
    """Return the matrices of a system with only the named states and inputs.

    states, inputs, residualize: as for `LinearModel.select`

    Raises BadInputError as `LinearModel.select` does.
    """
    if states is None:
        states = tuple(name for name in whole.states if name not in residualize)
    rows = positions("state", states, whole.states)
    columns = positions("input", inputs, whole.inputs)
    for name in residualize:
        if name in [*states]:
            raise BadInputError(
                f"state {name} is both kept and residualized; name it in states or in residualize"
            )
    following = positions("state", residualize, whole.states)
    if not rows:
        raise BadInputError(
            "residualize contains every state of the model; remove at least one state"
        )
    # Outputs that are the states, as by default, become the kept states.
    outputs = rows if whole.outputs == whole.states else list(range(len(whole.outputs)))

    n, m = whole.B.shape
    # Columns of the kept states, the kept inputs, and all disturbances:
    chosen = [*rows, *(n + column for column in columns), *range(n + m, n + m + whole.E.shape[1])]
    by_columns = np.hstack([whole.A, whole.B, whole.E])[:, chosen]
    CDF = np.hstack([whole.C, whole.D, whole.F])[np.ix_(outputs, chosen)]
    ABE = by_columns[rows]

    if following:  # x2 = -A22⁻¹ (A21 x1 + B2 u + E2 w)
        A22 = whole.A[np.ix_(following, following)]
        if not spectrum(A22).values.all():
            names = ", ".join(whole.states[i] for i in following)
            raise BadInputError(
                f"{names} cannot be residualized, because the block A22 of A for these "
                "states is singular; residualize fewer states"
            )
        followers_by_columns = -np.linalg.solve(A22, by_columns[following])
        ABE = ABE + whole.A[np.ix_(rows, following)] @ followers_by_columns
        CDF = CDF + whole.C[np.ix_(outputs, following)] @ followers_by_columns

    ends = np.cumsum([len(rows), len(columns)])
    A, B, E = np.split(ABE, ends, axis=1)
    C, D, F = np.split(CDF, ends, axis=1)
    return Matrices(
        A=A,
        B=B,
        C=C,
        D=D,
        E=E,
        F=F,
        output_offsets=whole.output_offsets[outputs],
        states=tuple(whole.states[i] for i in rows),
        inputs=tuple(whole.inputs[i] for i in columns),
        outputs=tuple(whole.outputs[i] for i in outputs),
    )


def reduction_note(kept: Matrices, whole: Matrices) -> str:
    """Return a note on the states that a reduced system leaves out, and on the change of the
    eigenvalues, or "" if all states are kept.

    kept: the reduced system
    whole: the system with all states
    """
    truncated = [name for name in whole.states if name not in kept.states]
    if not truncated:
        return ""
    eigenvalues = spectrum(whole.A).values
    percent = 100.0 * max(
        _relative_distance(value, eigenvalues) for value in spectrum(kept.A).values
    )
    verb = "is" if len(truncated) == 1 else "are"
    return (
        f"{', '.join(truncated)} {verb} left out (truncated); the eigenvalues differ by up to "
        f"{percent:.2g} % from the eigenvalues with all {len(whole.states)} states "
        "(select(residualize=...) keeps the steady effect of states)"
    )


def _relative_distance(value: complex, eigenvalues: np.ndarray) -> float:
    """Return the least |value - λ| / |λ| over eigenvalues λ, 0 for one of them."""
    distances = np.abs(value - eigenvalues)
    sizes = np.abs(eigenvalues)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.where(distances == 0.0, 0.0, distances / sizes).min())
