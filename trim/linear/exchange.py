"""Conversion of linear models to objects of other packages."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import control

    from trim.linear.linear_model import LinearModel


def state_space(model: LinearModel) -> control.StateSpace:
    """Return the linear model as a python-control StateSpace, with the names of its signals."""
    import control

    return control.ss(
        model.A,
        model.B,
        model.C,
        model.D,
        states=list(model.states),
        inputs=list(model.inputs),
        outputs=list(model.outputs),
    )
