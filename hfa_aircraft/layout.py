"""Equations of a model and their exact derivatives as CasADi expressions.

They are built once for all models with the same equations.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.signals import VECTORS, record
from hfa_support.errors import BadInputError, refuse_unknown, shown
from hfa_support.native.bound import RowFunction

#: Exceptions that a user's equations raise if they do not support CasADi expressions.
_FAILURES = (
    AttributeError,
    TypeError,
    ValueError,
    LookupError,
    NameError,
    ArithmeticError,
    RuntimeError,
    NotImplementedError,
    AssertionError,
)


class SignalNames(NamedTuple):
    """Names of the signals of a model, each group in order."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    disturbances: tuple[str, ...]
    outputs: tuple[str, ...]


class Layout(NamedTuple):
    """Equations and signal names of a model, without the values of its parameters.

    name: name of the model
    equations: equations of the `Model`
    names: names of the signals
    replaced: pairs (state, output) of the `Model`: the output is a variable of a trim in place of
        the state
    variables: names of the variables of a trim, `Model.variables`
    linear: names of the states of linear models
    """

    name: str
    equations: Callable[..., Any]
    names: SignalNames
    replaced: tuple[tuple[str, str], ...]
    variables: tuple[str, ...]
    linear: tuple[str, ...]

    @property
    def has_nan(self) -> bool:
        """True if the state derivatives contain the constant NaN, as after math.sin of a symbol."""
        vectors = self.symbols("x", "u", "p")
        rates, _ = self.expressions(vectors, ())
        function = ca.Function("f", vectors, [rates])
        constants = [
            function.instruction_constant(number)
            for number in range(function.n_instructions())
            if function.instruction_id(number) == ca.OP_CONST
        ]
        return any(math.isnan(constant) for constant in constants)

    def refuse_steps(self, jacobian: ca.SX, names: Sequence[str]) -> None:
        """Raise BadInputError if a variable affects the equations only in steps.

        All derivatives with respect to such a variable are 0. Such a variable must be declared as a
        parameter.

        jacobian: (m, k), with a column for each variable
        names: names of the k variables
        """
        # CasADi keeps the derivative 0 of a step (floor, >=) as an entry. A variable that is in no
        # equation has no entry, and is permitted.
        has_entry = ca.DM(jacobian.sparsity(), 1).full().any(axis=0)
        has_slope = ca.DM(ca.sparsify(jacobian).sparsity(), 1).full().any(axis=0)
        for name, entry, slope in zip(names, has_entry, has_slope, strict=True):
            if entry and not slope:
                raise BadInputError(
                    f"{self.name}: all derivatives with respect to {name} are 0, because {name} "
                    f"is discrete; declare {name} as a parameter"
                )

    def symbols(self, *vectors: str) -> list[ca.SX]:
        """Return new CasADi symbols, one column for each of the given vectors.

        vectors: "x", "u", "p" or "w"
        """
        return [ca.SX.sym(v, len(getattr(self.names, VECTORS[v]))) for v in vectors]

    def expressions(
        self, vectors: Sequence[Any], outputs: Sequence[str], w: Any = None
    ) -> tuple[ca.SX, ca.SX]:
        """Return the rates f (n,) and the chosen outputs or states (k,) as CasADi expressions.

        vectors: x, u and p, each a CasADi column, or a sequence of numbers and expressions
        outputs: names of outputs or states
        w: the disturbances, in the same form; None for 0

        Raises BadInputError if the equations are faulty.
        """
        symbols, f, output_expressions = symbolic(self, undisturbed=w is None)
        x, *_ = symbols
        known = {**output_expressions, **dict(zip(self.names.states, ca.vertsplit(x), strict=True))}
        y = ca.densify(column(known[name] for name in outputs))
        columns = [column(vector) for vector in (vectors if w is None else [*vectors, w])]
        f_there, y_there = ca.substitute([f, y], symbols, columns)
        return f_there, y_there

    def in_variables(
        self, values: Mapping[str, Any], p: ca.SX, outputs: Sequence[str]
    ) -> list[ca.SX]:
        """Return x, u, f and the chosen outputs as expressions of a trim's variables, at w = 0.

        A state in `replaced` is computed from the output y that replaces it: with y affine in the
        state x, x = (y - y(0)) / (dy/dx).

        values: variable of the trim -> value, a number or an expression; 0 for others
        p: parameters
        outputs: names of outputs or states

        Raises BadInputError if a replacing output does not depend on its state in an affine way.
        """
        replaced_symbols = {state: ca.SX.sym(state) for state, _ in self.replaced}
        x: list[Any] = [
            replaced_symbols.get(name, values.get(name, 0.0)) for name in self.names.states
        ]
        u = [values.get(name, 0.0) for name in self.names.inputs]
        replacing = [output for _, output in self.replaced]
        f, y_and_replacing = self.expressions((x, u, p), (*outputs, *replacing))
        y = y_and_replacing[: len(outputs)]
        parts: Any = [column(map(ca.SX, x)), column(u), f, y]
        for row, (state, output) in enumerate(self.replaced, start=len(outputs)):
            symbol = replaced_symbols[state]
            expression = y_and_replacing[row]
            slope = ca.jacobian(expression, symbol)
            if slope.is_zero() or ca.depends_on(slope, symbol):
                raise BadInputError(
                    f"{self.name}: {output} replaces {state} and must depend affinely on {state}"
                )
            at_zero = ca.substitute(expression, symbol, 0)
            parts = ca.substitute(parts, [symbol], [(values.get(output, 0.0) - at_zero) / slope])
        return [ca.densify(part) for part in parts]


def column(entries: Iterable[Any] | ca.SX | ca.DM) -> ca.SX:
    """Return numbers and expressions, or a CasADi column of them, as SX, also if there are none."""
    if isinstance(entries, ca.SX | ca.DM):
        # CasADi may return an empty slice of a column as a row, (1, 0).
        return ca.vec(ca.SX(entries))
    return ca.vertcat(ca.SX(0, 1), *entries)


class Linearization(NamedTuple):
    """Rates f and outputs y of a model at a point, with their derivatives.

    f: rates, (n,)
    y: outputs, (k,)
    A, B, E: derivatives of f with respect to x, u and w, (n, n), (n, m) and (n, d)
    C, D, F: derivatives of y with respect to x, u and w, (k, n), (k, m) and (k, d)
    """

    f: np.ndarray
    y: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray
    F: np.ndarray


@lru_cache(maxsize=64)
def linearized(
    layout: Layout, outputs: tuple[str, ...], disturbances: tuple[str, ...]
) -> ca.Function:
    """Return the CasADi function (x, u, p) -> fields of a `Linearization` in their order, at w = 0.

    outputs: names of outputs or states
    disturbances: names of the disturbances in w

    Raises BadInputError for an unknown disturbance, for an input or a state of linear models that
    affects f only in steps, and for faulty equations.
    """
    x, u, p = layout.symbols("x", "u", "p")
    w = ca.SX.sym("w", len(disturbances))  # other disturbances are 0
    for name in disturbances:
        refuse_unknown("unknown disturbance", name, layout.names.disturbances)
    f, y = layout.expressions((x, u, p), outputs)
    A = ca.jacobian(f, x)
    B = ca.jacobian(f, u)
    columns = [layout.names.states.index(name) for name in layout.linear]
    layout.refuse_steps(A[:, columns], layout.linear)
    layout.refuse_steps(B, layout.names.inputs)
    parts = [f, y, A, B, ca.jacobian(y, x), ca.jacobian(y, u)]
    if disturbances:
        winds = dict(zip(disturbances, ca.vertsplit(w), strict=True))
        every_wind = [winds.get(name, 0.0) for name in layout.names.disturbances]
        for expression in layout.expressions((x, u, p), outputs, every_wind):
            parts.append(ca.substitute(ca.jacobian(expression, w), w, 0))
    else:
        parts += [ca.SX(f.numel(), 0), ca.SX(y.numel(), 0)]
    dense = [ca.densify(part) for part in parts]
    return ca.Function("linearized", [x, u, p], dense, ["x", "u", "p"], Linearization._fields)


@lru_cache(maxsize=16)
def linearized_rows(
    layout: Layout, outputs: tuple[str, ...], disturbances: tuple[str, ...]
) -> RowFunction:
    """Return `linearized` as a function of rows (x, u, p), whose one result is a row with f, y, A,
    B, C, D, E and F, each matrix row by row.
    """
    arguments = layout.symbols("x", "u", "p")
    parts = linearized(layout, outputs, disturbances)(*arguments)
    flat = ca.vertcat(*(ca.vec(part.T) for part in parts))  # ca.vec stacks columns
    return RowFunction(ca.Function("linearized_rows", arguments, [flat]))


class _Symbolic(NamedTuple):
    """Equations as CasADi expressions.

    symbols: columns x, u, p and, unless the disturbances are 0, w
    f: rates of the states, (n,)
    outputs: name -> output
    """

    symbols: list[ca.SX]
    f: ca.SX
    outputs: Mapping[str, Any]


@lru_cache(maxsize=16)
def symbolic(layout: Layout, *, undisturbed: bool) -> _Symbolic:
    """Return the rates and outputs of a model as expressions.

    undisturbed: whether the disturbances are 0, and have no symbols

    Raises BadInputError if the equations fail or do not return exactly the declared names.
    """
    if undisturbed and not layout.names.disturbances:  # one evaluation serves both cases
        with_empty_w = symbolic(layout, undisturbed=False)
        return with_empty_w._replace(symbols=with_empty_w.symbols[:3])
    symbols = layout.symbols(*("xup" if undisturbed else VECTORS))
    values: list[Any] = [ca.vertsplit(vector) for vector in symbols]
    if undisturbed:
        values.append([0.0 for _ in layout.names.disturbances])
    # The names of x, u, p and w; the outputs, which follow, are no arguments.
    groups = zip(layout.names[:4], values, strict=True)
    arguments = [record(names)(*vector) for names, vector in groups]
    try:
        with warnings.catch_warnings(action="ignore", category=FutureWarning):
            # CasADi issues a FutureWarning for functions of NumPy.
            returned = layout.equations(*arguments)
    except _FAILURES as error:
        raise _failure_of_equations(error, layout, arguments) from error
    is_pair = isinstance(returned, tuple) and len(returned) == 2
    if not (is_pair and all(hasattr(part, "keys") for part in returned)):
        raise BadInputError(
            f"{layout.name}: the equations return a {type(returned).__name__}; return two dicts, "
            "rates by state and outputs by name (for algebraic equations, solve for the unknowns)"
        )
    rates = _scalars(layout, "rate of", returned[0], layout.names.states)
    outputs = _scalars(layout, "output", returned[1], layout.names.outputs)
    # Two symbols of one name are different, so symbols are compared by their hashes.
    known = {symbol.element_hash() for symbol in ca.symvar(ca.vertcat(*symbols))}
    for symbol in ca.symvar(column([*rates.values(), *outputs.values()])):
        if symbol.element_hash() not in known:
            raise BadInputError(
                f"{layout.name}: the equations use the symbol {shown(symbol.name())}, which has no "
                "value; write a number, or a name of x, u, p or w"
            )
    return _Symbolic(symbols, ca.densify(column(rates.values())), outputs)


def _scalars(
    layout: Layout, kind: str, values: Mapping[str, Any], names: Sequence[str]
) -> dict[str, ca.SX]:
    """Return name -> scalar CasADi expression of the rates or outputs that equations return.

    kind: "rate of" or "output", for messages
    names: the declared names, in order

    Raises BadInputError for a missing or undeclared name, and for a value that is no number.
    """
    scalars: dict[str, ca.SX] = {}
    for name in names:
        if name not in values:
            raise BadInputError(f"{layout.name}: the equations return no {kind} {name}; return one")
        try:
            scalars[name] = ca.SX(values[name])
        except (NotImplementedError, TypeError, ValueError) as error:
            raise BadInputError(
                f"{layout.name}: the {kind} {name} is {shown(values[name])}; return a number"
            ) from error
        if (count := scalars[name].numel()) != 1:
            raise BadInputError(
                f"{layout.name}: the {kind} {name} has {count} entries; return one number"
            )
    for name in values:
        refuse_unknown(f"{layout.name}: the equations return the undeclared {kind}", name, names)
    return scalars


def _failure_of_equations(error: Exception, layout: Layout, arguments: list[Any]) -> BadInputError:
    """Return the error for a model whose equations raised an exception, called with x, u, p, w."""
    # An unknown field of x, u, p or w raises an AttributeError of that named tuple. The names of
    # the outputs, which follow in layout.names, belong to no argument.
    for kind, vector, names in zip(VECTORS.values(), arguments, layout.names, strict=False):
        if isinstance(error, AttributeError) and error.obj is vector:
            refuse_unknown(
                f"{layout.name}: the equations use an undeclared name of {kind},",
                error.name,
                names,
            )
    said = " ".join(str(error).split())[:200]
    advice = (
        f"fail ({type(error).__name__}: {said}); use ca.if_else instead of if, and "
        "CasADi's functions (ca.sin) instead of those of other packages"
    )
    if "indices must be integers" in said:
        advice = f"use x['NAME']; write x.NAME ({said})"
    try:
        inspect.signature(layout.equations).bind(*arguments)
    except TypeError:
        advice = "do not accept (x, u, p, w); declare all four, also those that are not used"
    return BadInputError(f"{layout.name}: the equations {advice}")
