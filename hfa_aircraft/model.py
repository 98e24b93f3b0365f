"""One declaration of a model x' = f(x, u, p, w), y = h(x, u, p, w): all packages take equations and
names from it."""

from __future__ import annotations

import math
import re
import warnings
from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError, is_finite, refuse_unknown, shown
from hfa_support.native.bound import BoundFunction, cached_per_thread
from hfa_support.reporting.text import shown_unit, shown_value

if TYPE_CHECKING:
    import control

#: The four vectors that a model's equations take, in CasADi's order, and the declarations of their
#: components.
VECTORS = {"x": "states", "u": "inputs", "p": "parameters", "w": "disturbances"}


class Signal(NamedTuple):
    """What is known of a state, input, parameter, disturbance or output beside its name.

    unit: as text, "1" for none. nominal: its typical size, > 0, which weighs unknowns and residuals
    of different units. min, max: where the equations hold; limits of a trim. start: the value of a
    parameter, and where a search for a state or an input begins. rate: the typical size of a
    state's rate; the state's own nominal unless given. The words are those of FMI 3 and
    casadi.DaeBuilder."""

    unit: str = "1"
    nominal: float = 1.0
    min: float = -math.inf
    max: float = math.inf
    start: float = 0.0
    rate: float | None = None


_RECORDS: dict[tuple[str, ...], Any] = {}


def record(names: tuple[str, ...]) -> Any:
    """The named tuple with these fields: the class that a declaration was written in, or a new
    one."""
    if names not in _RECORDS:
        pickled = {"__reduce__": lambda values: (_unpickled, (names, tuple(values)))}
        _RECORDS[names] = type("Values", (namedtuple("Values", names),), pickled)
    return _RECORDS[names]


def _unpickled(names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    return record(names)(*values)


class Linearization(NamedTuple):
    """f (n,), y (k,) and their derivatives by x, u, w: A (n, n), B, C (k, n), D, E, F."""

    f: np.ndarray
    y: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray
    F: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """x' = f(x, u, p, w), y = h(x, u, p, w), declared once.

    states, inputs, parameters, disturbances, outputs: name -> `Signal`, in the order of the
    vectors. equations: (x, u, p, w) with fields by name -> (rates by state, outputs by name); it
    takes numbers or CasADi expressions and returns the same. It must return every declared output.
    trim: the values that a trim imposes by default, name of a state, an input or an output ->
    value. steady: the states whose rates a trim balances; all of them unless given. linear: the
    states of the linear model; all of them unless given. schedule: the name of the state, input or
    parameter that sweeps, gain tables and proofs run over. modes: name of a mode -> the states that
    take part most. replaced: state -> output, affine in it, that people name in its place in a
    trim: pitch -> gamma. parts: ending -> linear states; OUTPUT_ending names the part of an output
    that these states, the inputs and the disturbances cause, for controllers. variants: names of
    its other equations, which a design may treat differently. range: state -> (largest absolute
    value, whose): beyond it models come with a warning. envelope: (x, p) of a trim, by name ->
    limits of the states that a flight about it keeps where they are not min and max: state ->
    (lowest, highest). check: raises BadInputError for a state, by name, where the equations mean
    nothing whatever the limits. called: how reports name it; its name unless given. source: the
    file and name that it was loaded from, and a hash. alternatives: groups of names of which a trim
    imposes one: to impose another sets it free. begin: imposed values by name, numbers or
    arrays -> where a search for others begins; the value of the first of a group is exact. explain: (imposed values, solve) -> why there is no trim, in
    the words of its field (`trim.point.reasons`). aliases: name in another program -> name here. notes: what every report says of
    it. BadInputError when a name is not an
    identifier, is declared twice or is unknown, or when a number cannot be."""

    name: str
    states: Mapping[str, Signal]
    inputs: Mapping[str, Signal]
    equations: Callable[[Any, Any, Any, Any], tuple[Mapping[str, Any], Mapping[str, Any]]]
    parameters: Mapping[str, Signal] = field(default_factory=dict)
    disturbances: Mapping[str, Signal] = field(default_factory=dict)
    outputs: Mapping[str, Signal] = field(default_factory=dict)
    trim: Mapping[str, float] = field(default_factory=dict)
    steady: tuple[str, ...] = ()
    linear: tuple[str, ...] = ()
    schedule: str = ""
    modes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    replaced: Mapping[str, str] = field(default_factory=dict)
    parts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    variants: tuple[str, ...] = ()
    range: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]] | None = None
    check: Callable[[Any], None] | None = None
    called: str = ""
    source: tuple[str, str] = ("", "")
    alternatives: tuple[tuple[str, ...], ...] = ()
    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    explain: Callable[[Mapping[str, float], Callable[..., Any]], str] | None = None
    aliases: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the declaration before anything is compiled."""
        seen: set[str] = set()
        for kind in ("states", "inputs", "parameters", "disturbances", "outputs"):
            given: Any = getattr(self, kind)
            if hasattr(given, "_asdict"):
                _RECORDS[given._fields] = type(given)
                given = given._asdict()
            object.__setattr__(self, kind, dict(given))
            for name, signal in given.items():
                if not (
                    isinstance(name, str)
                    and name.isidentifier()
                    and name.isascii()
                    and name[0] != "_"
                ):
                    raise BadInputError(
                        f"{self.name}: {shown(name)} in {kind} is not an identifier; rename it"
                    )
                if name in seen:
                    raise BadInputError(
                        f"{self.name}: {name} is declared twice; rename one of them"
                    )
                seen.add(name)
                _check_signal(f"{self.name}: {name}", signal)
        if not self.states:
            raise BadInputError(f"{self.name} declares no states; a model needs at least one")
        for kind in ("steady", "linear"):
            object.__setattr__(self, kind, tuple(getattr(self, kind)) or tuple(self.states))
        for what, names, known in (
            ("steady names the unknown state", self.steady, self.states),
            ("linear names the unknown state", self.linear, self.states),
            ("trim imposes the unknown variable", self.trim, (*self.variables, *self.outputs)),
            (
                "schedule is the unknown variable",
                [self.schedule] * bool(self.schedule),
                [*self.signals],
            ),
            (
                "parts names the unknown linear state",
                [each for part in self.parts.values() for each in part],
                self.linear,
            ),
        ):
            for name in names:
                refuse_unknown(f"{self.name}: {what}", name, known)
        for name, value in self.trim.items():
            if not math.isfinite(value):
                raise BadInputError(
                    f"{self.name}: trim imposes {name} = {value}; give a finite number"
                )

    def __repr__(self) -> str:
        counts = (
            f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        )
        return f"<Model {self.title}: {counts}>"

    def __reduce__(self) -> Any:
        if not self.source[0]:
            return super().__reduce__()
        return _reloaded, (
            self.source,
            {name: signal.start for name, signal in self.parameters.items()},
        )

    @property
    def title(self) -> str:
        """How reports name it."""
        return self.called or self.name

    @property
    def schedule_unit(self) -> str:
        """Unit in which people write the scheduling variable: of an angle degrees."""
        return "deg" if self.unit(self.schedule) == "rad" else self.unit(self.schedule)

    @property
    def schedule_key(self) -> str:
        """What files and data call its values in that unit: dihedral_deg, speed."""
        return self.schedule + "_deg" * (self.schedule_unit == "deg")

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """Everything that has a name."""
        return {
            **self.states,
            **self.inputs,
            **self.outputs,
            **self.parameters,
            **self.disturbances,
        }

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """What a trim imposes or finds: states, some replaced by outputs, and inputs."""
        return self.layout.variables

    @cached_property
    def holdable(self) -> tuple[str, ...]:
        """What a trim can impose: variables and outputs."""
        return tuple(dict.fromkeys((*self.variables, *self.outputs)))

    @cached_property
    def measurable(self) -> tuple[str, ...]:
        """What a controller can measure: states, outputs and the parts of outputs."""
        return (
            *self.states,
            *self.outputs,
            *(f"{name}_{part}" for part in self.parts for name in self.outputs),
        )

    def part(self, name: str) -> tuple[str, tuple[str, ...]]:
        """The output or state that a name of `measurable` is about, and the linear states whose
        effect on it counts."""
        for ending, states in self.parts.items():
            if (whole := name.removesuffix(f"_{ending}")) != name and whole in self.outputs:
                return whole, states
        return name, self.linear

    @cached_property
    def rates(self) -> dict[str, Signal]:
        """The rates of the states, which a trim can impose too: speed_dot of speed, unless that
        name is declared."""
        return {
            f"{name}_dot": Signal(self.rate_unit(name), self.rate_scale(name))
            for name in self.states
            if f"{name}_dot" not in self.signals
        }

    def refuse_unheld(self, what: str, name: str, also: Sequence[str] = ()) -> None:
        """BadInputError unless a trim can impose the name: `holdable`, the rate of a state, or one
        of the others."""
        if name not in self.rates:
            refuse_unknown(what, name, dict.fromkeys((*self.holdable, *also)))

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of each state, input and output."""
        return {
            name: (each.min, each.max)
            for name, each in self.signals.items()
            if name not in self.parameters
        }

    def unit(self, name: str) -> str:
        """Unit of whatever has a name."""
        return (self.signals.get(name) or self.rates[name]).unit

    def units(self, names: Sequence[str]) -> tuple[str, ...]:
        """Their units, in order."""
        return tuple(map(self.unit, names))

    @cached_property
    def time_unit(self) -> str:
        """s; min, h or day where units are made of it and none of s."""
        bases = {base for each in self.signals.values() for base in re.findall("[a-z]+", each.unit)}
        longer = [unit for unit in ("min", "h", "day") if unit in bases]
        return longer[0] if longer and "s" not in bases else "s"

    def rate_unit(self, name: str) -> str:
        """Unit of a state's rate: ft/s of ft, ft/s^2 of ft/s."""
        per_time = f"/{self.time_unit}"
        head, slash, power = self.unit(name).rpartition(per_time)
        if slash and (not power or power[1:].isdigit()):
            return f"{head}{per_time}^{int(power[1:] or 1) + 1}"
        return f"{self.unit(name)}{per_time}"

    def rate_scale(self, name: str) -> float:
        """One scaled unit of a state's rate."""
        return self.states[name].rate or self.states[name].nominal

    def entry_unit(self, row: str, column: str) -> str:
        """Unit of the entry of A or B that the rate of a state (row) has per state or input
        (column), as text."""
        return f"({self.rate_unit(row)})/({self.unit(column)})"

    def describe(self, name: str, value: float) -> str:
        """A value with its unit as an engineer reads it: angles in degrees."""
        unit = self.unit(name)
        return shown_value(value, unit) + ("" if unit == "1" else f" {shown_unit(unit)}")

    def with_parameters(self, **values: float) -> Model:
        """The same model with other values of parameters."""
        changed = dict(self.parameters)
        for name, value in values.items():
            refuse_unknown(f"{self.name} has no parameter", name, tuple(self.parameters))
            changed[name] = self.parameters[name]._replace(start=float(value))
        return replace(self, parameters=changed)

    @cached_property
    def p(self) -> np.ndarray:
        """The values of the parameters, in order."""
        return np.array([signal.start for signal in self.parameters.values()], dtype=float)

    @cached_property
    def layout(self) -> Layout:
        """What its Functions depend on: all but numbers."""
        names = (tuple(getattr(self, kind)) for kind in (*VECTORS.values(), "outputs"))
        return Layout(self.name, self.equations, tuple(names), tuple(self.replaced.items()))

    def functions(
        self, outputs: Sequence[str] | None = None, disturbances: Sequence[str] = ()
    ) -> ca.Function:
        """(x, u, p) -> the parts of a `Linearization` at w = 0, of these outputs (all unless
        given)."""
        return _linearized(
            self.layout, tuple(self.outputs if outputs is None else outputs), tuple(disturbances)
        )

    def at(
        self, x: Any, u: Any, outputs: Sequence[str] = (), disturbances: Sequence[str] = ()
    ) -> Linearization:
        """f, y and their derivatives, exact to rounding. FloatingPointError where one is not
        finite."""
        bound = _bound_linearized(self.layout, tuple(outputs), tuple(disturbances))
        for place, value in zip(bound.inputs, (x, u, self.p), strict=True):
            place[:] = value
        bound()
        n, m, k, d = len(self.states), len(self.inputs), len(outputs), len(disturbances)
        shapes = ((n,), (k,), (n, n), (n, m), (k, n), (k, m), (n, d), (k, d))
        columns = zip(bound.results, shapes, strict=True)
        found = Linearization(
            *(np.array(each.reshape(shape, order="F"), order="C") for each, shape in columns)
        )
        if not all(np.isfinite(part).all() for part in found):
            values = dict(zip((*self.states, *self.inputs), (*x, *u), strict=True))
            raise FloatingPointError(self.not_finite(found.f, values, list(self.states)))
        return found

    def not_finite(
        self, rates: np.ndarray, values: Mapping[str, float], names: Sequence[str]
    ) -> str:
        """Which rate is not a number, and where."""
        wrong = [name for name, rate in zip(names, rates, strict=True) if not math.isfinite(rate)]
        what = f"the rate of {wrong[0]}" if wrong else "a derivative"
        if self.layout.has_nan:
            return f"{self.name}: {what} contains a number that is none; use CasADi's functions (ca.sin), not math's"
        where = ", ".join(self.describe(name, value) + f" {name}" for name, value in values.items())
        return f"{self.name}: {what} is not a number at {where}; correct the equations or narrow min and max"

    def outputs_at(
        self, x: Sequence[float], u: Sequence[float], names: Sequence[str] | None = None
    ) -> dict[str, float]:
        """Outputs, all unless named, at a state and an input."""
        found = self._numbers_at(x, u)[1]
        return {name: float(found[name]) for name in (self.outputs if names is None else names)}

    def rates_at(self, x: Sequence[float], u: Sequence[float]) -> dict[str, float]:
        """The rate of every state at a state and an input."""
        found = self._numbers_at(x, u)[0]
        return {name: float(found[name]) for name in self.states}

    def _numbers_at(
        self, x: Sequence[float], u: Sequence[float]
    ) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Rates and outputs by name."""
        numbers = [list(map(float, each)) for each in (x, u, self.p)]
        still_air = [0.0 for _ in self.disturbances]
        records = map(self.layout.record, VECTORS, (*numbers, still_air))
        try:
            return self.layout.equations(*records)
        except RuntimeError:  # some functions of CasADi (pw_lin) take symbols only
            f, y = self.functions()(*numbers)[:2]
            rates = dict(zip(self.states, ca.vertsplit(f), strict=True))
            return rates, dict(zip(self.outputs, components(y), strict=True))

    def to_control(self, outputs: Sequence[str] | None = None) -> control.NonlinearIOSystem:
        """x' = f(x, u, p), y = the named states and outputs (all unless given) for python-control,
        names kept."""
        from hfa_aircraft.control_systems import to_control

        return to_control(self, outputs)

    @staticmethod
    def from_control(
        system: control.NonlinearIOSystem, units: Mapping[str, Any], **declared: Any
    ) -> Model:
        """The model of a system of python-control that can be traced:
        `control_systems.from_control`."""
        from hfa_aircraft.control_systems import from_control

        return from_control(system, units, **declared)


#: What equations raise that do not take expressions.
_FAILURES = (
    *(AttributeError, TypeError, ValueError, LookupError, NameError, ArithmeticError),
    *(RuntimeError, NotImplementedError, AssertionError),
)


class Layout(NamedTuple):
    """What a model's Functions depend on: equations and names."""

    name: str
    equations: Callable[..., Any]
    names: tuple[tuple[str, ...], ...]
    replaced: tuple[tuple[str, str], ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """What a trim imposes or finds."""
        instead = dict(self.replaced)
        return (*(instead.get(name, name) for name in self.names[0]), *self.names[1])

    @property
    def has_nan(self) -> bool:
        """Whether a constant of the equations is not a number: math.sin makes one of a symbol."""
        vectors = self.symbols("x", "u", "p")
        function = ca.Function(
            "f", vectors, [self.expressions(list(map(components, vectors)), ())[0]]
        )
        every = range(function.n_instructions())
        return any(
            math.isnan(function.instruction_constant(k))
            for k in every
            if function.instruction_id(k) == ca.OP_CONST
        )

    def refuse_steps(self, jacobian: ca.SX, names: Sequence[str]) -> None:
        """BadInputError for a variable (column) that acts in steps only: every slope is 0, though
        equations have it."""
        felt, moving = (
            ca.DM(jacobian.sparsity(), 1).full(),
            ca.DM(ca.sparsify(jacobian).sparsity(), 1).full(),
        )
        for name, has, moves in zip(names, felt.any(axis=0), moving.any(axis=0), strict=True):
            if has and not moves:
                raise BadInputError(
                    f"{self.name}: {name} is discrete, its slopes are all 0; declare it as a parameter"
                )

    def record(self, vector: str, values: Any) -> Any:
        """The values of x, u, p or w by name."""
        return record(self.names[list(VECTORS).index(vector)])(*values)

    def symbols(self, *vectors: str) -> list[ca.SX]:
        """New symbols, a column for each of "x", "u", "p", "w"."""
        return [
            ca.SX.sym(vector, len(self.names[list(VECTORS).index(vector)])) for vector in vectors
        ]

    def expressions(
        self, vectors: Sequence[Any], outputs: Sequence[str], w: Any = None
    ) -> tuple[ca.SX, ca.SX]:
        """f (n,) and the named outputs or states (k,) at the components of x, u, p; without
        disturbances unless given. BadInputError as in `_symbolic`."""
        symbols, f, found = _symbolic(self, w is None)
        states = self.names[0]
        chosen = [
            symbols[0][states.index(name)] if name in states else found[name] for name in outputs
        ]
        columns = [ca.vertcat(ca.SX(0, 1), *each) for each in (*vectors, *[w] * (w is not None))]
        f, y = ca.substitute(
            [f, ca.densify(ca.SX(ca.vertcat(ca.SX(0, 1), *chosen)))], symbols, columns
        )
        return f, y

    def in_variables(
        self, values: Mapping[str, Any], p: ca.SX, outputs: Sequence[str]
    ) -> list[ca.SX]:
        """x, u, f and the named outputs, where `values` has each variable of a trim, in still air.

        The states in `replaced` follow from the outputs in their place: x = (value - y(0)) /
        (dy/dx)."""
        unknown = {state: ca.SX.sym(state) for state, _ in self.replaced}
        x: list[Any] = [unknown.get(name, values.get(name)) for name in self.names[0]]
        u = [values[name] for name in self.names[1]]
        found = [output for _, output in self.replaced]
        f, y = self.expressions((x, u, components(p)), (*outputs, *found))
        y, given = y[: len(outputs)], y[len(outputs) :]
        parts: Any = [ca.vertcat(*map(ca.SX, x)), ca.vertcat(ca.SX(0, 1), *u), f, y]
        for i, (state, output) in enumerate(self.replaced):
            symbol, slope = unknown[state], ca.jacobian(given[i], unknown[state])
            if slope.is_zero() or ca.depends_on(slope, symbol):
                raise BadInputError(
                    f"{self.name}: {output} cannot replace {state}; it must be affine in it"
                )
            instead = (values[output] - ca.substitute(given[i], symbol, 0)) / slope
            parts = ca.substitute(parts, [symbol], [instead])
        return [ca.densify(part) for part in parts]


def components(vector: Any) -> list[Any]:
    """Of a column, which may be empty."""
    return ca.vertsplit(vector) if vector.numel() else []


@lru_cache(maxsize=16)
def _symbolic(layout: Layout, still: bool) -> tuple[list[ca.SX], ca.SX, Mapping[str, Any]]:
    """Symbols x, u, p, w (none of w where the air is still) and, in these, f and the outputs by
    name: they take longer to build than all that is made of them. BadInputError names what the
    equations leave out."""
    vectors = layout.symbols(*list(VECTORS)[: 3 if still else 4])
    given = [*map(components, vectors), *[[0.0] * len(layout.names[3])] * still]
    named: list[Any] = [layout.record(*each) for each in zip(VECTORS, given, strict=True)]
    try:
        with warnings.catch_warnings(
            action="ignore", category=FutureWarning
        ):  # CasADi's, of functions of NumPy
            returned = layout.equations(*named)
    except _FAILURES as error:
        for kind, values, names in zip(VECTORS.values(), named, layout.names, strict=False):
            if isinstance(error, AttributeError) and error.obj is values:
                refuse_unknown(
                    f"{layout.name}: the equations use an undeclared name of {kind},",
                    error.name,
                    names,
                )
        said = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        advice = (
            "write ca.if_else for if, and CasADi's functions (ca.sin) for those of other packages"
        )
        raise BadInputError(f"{layout.name}: the equations fail ({said}); {advice}") from error
    if not (
        isinstance(returned, tuple)
        and len(returned) == 2
        and all(hasattr(each, "keys") for each in returned)
    ):
        raise BadInputError(
            f"{layout.name}: the equations return {shown(returned)}; return rates by state and outputs by name, two "
            "dicts (algebraic residuals are not supported: solve them, or make what they determine a state)"
        )
    rates, found = returned
    for kind, values, names in (
        ("rate", rates, layout.names[0]),
        ("output", found, layout.names[4]),
    ):
        for name in (*names, *values):
            if name not in values:
                raise BadInputError(
                    f"{layout.name}: the equations return no {kind} of {name}; add it"
                )
            refuse_unknown(
                f"{layout.name}: the equations return the undeclared {kind}", name, names
            )
    return vectors, ca.densify(ca.SX(ca.vertcat(*(rates[name] for name in layout.names[0])))), found


@lru_cache(maxsize=64)
def _linearized(
    layout: Layout, outputs: tuple[str, ...], disturbances: tuple[str, ...]
) -> ca.Function:
    (x, u, p), w = layout.symbols("x", "u", "p"), ca.SX.sym("w", len(disturbances))
    for name in disturbances:
        refuse_unknown("unknown disturbance", name, layout.names[3])
    vectors = list(map(components, (x, u, p)))
    f, y = layout.expressions(vectors, outputs)
    parts = [f, y, *(ca.jacobian(of, by) for of in (f, y) for by in (x, u))]
    for jacobian, names in zip(parts[2:4], layout.names[:2], strict=True):
        layout.refuse_steps(jacobian, names)
    if disturbances:
        winds = dict(zip(disturbances, ca.vertsplit(w), strict=True))
        blown = layout.expressions(
            vectors, outputs, [winds.get(name, 0.0) for name in layout.names[3]]
        )
        parts += [ca.substitute(ca.jacobian(of, w), w, 0) for of in blown]
    else:
        parts += [ca.SX(f.numel(), 0), ca.SX(y.numel(), 0)]
    names = (
        "ode",
        "ydef",
        "jac_ode_x",
        "jac_ode_u",
        "jac_ydef_x",
        "jac_ydef_u",
        "jac_ode_w",
        "jac_ydef_w",
    )
    return ca.Function(
        "linearized", [x, u, p], list(map(ca.densify, parts)), ["x", "u", "p"], names
    )


@cached_per_thread(maxsize=16)
def _bound_linearized(*key: Any) -> BoundFunction:
    return BoundFunction(_linearized(*key))


def _check_signal(where: str, signal: Signal) -> None:
    if not isinstance(signal, Signal):
        raise BadInputError(f"{where} is {shown(signal)}; declare it as a Signal")
    sizes = (signal.nominal, signal.nominal if signal.rate is None else signal.rate)
    if not all(map(is_finite, (*sizes, signal.start))) or min(sizes) <= 0.0:
        raise BadInputError(
            f"{where}: nominal, start and rate must be finite numbers, nominal and rate positive"
        )
    if not signal.min <= signal.max:
        raise BadInputError(
            f"{where}: min {signal.min:g} is above max {signal.max:g}; exchange them"
        )


def load_model(place: str) -> Model:
    """The Model of `FILE.py:NAME` or `package.module:NAME`, which is executed, or of an aircraft of
    JSBSim, `jsbsim:NAME` or `FILE.xml`, which is read.

    BadInputError names the file and its fault.
    """
    import hashlib
    import importlib
    import sys
    import types
    from pathlib import Path

    if place.startswith("jsbsim:") or place.endswith(".xml"):
        from hfa_aircraft.jsbsim.reader import read_model

        return read_model(place)
    where, colon, name = place.rpartition(":")
    if not colon or not name.isidentifier():
        raise BadInputError(
            f"{shown(place)} is no aircraft; give FILE.py:NAME, package.module:NAME, jsbsim:NAME or FILE.xml"
        )
    try:
        if where.endswith(".py"):
            text, module = (
                Path(where).read_bytes(),
                types.ModuleType(f"aircraft_{Path(where).stem}"),
            )
            module.__file__, sys.modules[module.__name__] = (
                where,
                module,
            )  # for its tables, for its dataclasses
            exec(compile(text, where, "exec"), module.__dict__)
        else:
            if "" not in sys.path:
                sys.path.insert(0, "")
            module = importlib.import_module(where)
            text = Path(str(module.__file__)).read_bytes()
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error
    except OSError as error:
        what = f"{where}: {error.filename} cannot be read ({error.strerror})"
        raise BadInputError(f"{what}; give FILE.py:NAME") from error
    except Exception as error:  # whatever the user's file raises
        line = f" in line {error.lineno}" if isinstance(error, SyntaxError) else ""
        said = error.msg if isinstance(error, SyntaxError) else error
        raise BadInputError(
            f"{where}: {type(error).__name__}{line}: {said}; correct the file"
        ) from error
    found = getattr(module, name, None)
    if not isinstance(found, Model):
        known = [each for each, value in vars(module).items() if isinstance(value, Model)]
        what = "has no name" if found is None else f"holds {shown(found)}, not a Model, under"
        raise BadInputError(
            f"{where}: {what} {name}; " + (f"use {', '.join(known)}" if known else "define a Model")
        )
    return replace(found, source=(place, hashlib.sha256(text).hexdigest()))


def _reloaded(source: tuple[str, str], parameters: dict[str, float]) -> Model:
    """The model of a file in another process. BadInputError when the file has changed since."""
    found = load_model(source[0])
    if found.source != source:
        raise BadInputError(f"{source[0]} has changed since the work began; start again")
    return found.with_parameters(**parameters)
