"""Declaration of a model x' = f(x, u, p, w), y = h(x, u, p, w)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from hfa_aircraft.about import About, Domain, Source, Trimming
from hfa_aircraft.layout import (
    Layout,
    Linearization,
    SignalNames,
    linearized,
    linearized_rows,
    symbolic,
)
from hfa_aircraft.signals import (
    AIRSPEEDS,
    ISA,
    VECTORS,
    Signal,
    declared_signals,
    factor_to,
    meant_by,
    recognized,
    record,
    signals_report,
    usual_begin,
    usual_modes,
)
from hfa_support.errors import (
    BadInputError,
    NotFiniteError,
    is_finite,
    numbers_in,
    pair_of,
    refuse_unknown,
    shown,
)
from hfa_support.origin import fingerprint, instructions
from hfa_support.public_arguments import Declared
from hfa_support.reporting.report import Reported
from hfa_support.reporting.text import with_unit
from hfa_support.units import conversion_factor, split_unit

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from hfa_support.reporting.report import Report


@dataclass(frozen=True, eq=False, repr=False)
class Model(Declared, Reported):
    """Aircraft model x' = f(x, u, p, w), y = h(x, u, p, w).

    name: name of the model
    states, inputs, parameters, disturbances, outputs: name -> `Signal`, in the order of the vectors
    equations: function (x, u, p, w) -> (rates by state, outputs by name). The arguments are numbers
        or CasADi expressions, with fields by name.
    trim: state, input or output -> value that a trim imposes by default
    steady: states whose rates are zero in a trim, by default all
    linear: states of the linear model, by default all
    schedule: state, input or parameter over which sweeps, gain schedules and proofs run, or ""
    modes: name of a mode -> states that dominate it, by default those of `usual_modes`
    replaced: state -> output that replaces it as a variable of a trim, such as pitch -> gamma. The
        output must be affine in the state.
    parts: suffix -> linear states. The measurable quantity OUTPUT_suffix is the part of an output
        that these states, the inputs and the disturbances cause.
    domain, trimming: where the equations are valid, and what the model knows about its trims
    about, source: what reports call the model, and where it comes from

    Raises BadInputError if there are no states, if a name is unknown, declared twice or not an
    identifier, if a number is invalid, or if the equations fail.

    >>> import hfa
    >>> states = {"position": hfa.Signal("ft"), "velocity": hfa.Signal("ft/s")}
    >>> inputs = {"force": hfa.Signal("lbf")}
    >>> def equations(x, u, p, w):
    ...     return {"position": x.velocity, "velocity": u.force / 2.0}, {}
    >>> hfa.Model("cart", states, inputs, equations).at([0.0, 0.0], [1.0]).B.tolist()
    [[0.0], [0.5]]
    """

    name: str
    states: Mapping[str, Signal]
    inputs: Mapping[str, Signal]
    equations: Callable[..., tuple[Mapping[str, Any], Mapping[str, Any]]]
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
    domain: Domain = field(default_factory=Domain)
    trimming: Trimming = field(default_factory=Trimming)
    about: About = field(default_factory=About)
    source: Source = field(default_factory=Source)

    def __post_init__(self) -> None:
        """Check the declaration, and complete `steady`, `linear`, `modes` and `trim`.

        The equations are checked only if `source.reload` is None.

        Raises BadInputError, as described for the class.
        """
        groups = {kind: getattr(self, kind) for kind in (*VECTORS.values(), "outputs")}
        # The fields of the frozen class are set through vars(self).
        vars(self).update(declared_signals(self.name, groups))
        if not self.states:
            raise BadInputError(f"{self.name} declares no states; declare at least one")
        for kind in ("steady", "linear"):
            vars(self)[kind] = tuple(getattr(self, kind)) or tuple(self.states)
        if not self.modes:
            vars(self)["modes"] = usual_modes(self.states)
        if self.trimming.begin is None:
            vars(self)["trimming"] = replace(self.trimming, begin=usual_begin(self.states))
        vars(self)["trim"] = dict(self.trim)
        self._refuse_undeclared()
        for name, value in self.trim.items():
            if not is_finite(value):
                raise BadInputError(
                    f"{self.name}: trim imposes {name} = {value}; give a finite number"
                )
        for name, entry in self.domain.range.items():
            match entry:
                case (lowest, highest, str()):
                    pair_of(f"range of {name}", (lowest, highest))
                case _:
                    raise BadInputError(
                        f"range of {name} is {shown(entry)}; give (lowest, highest, source)"
                    )
        if self.source.reload is None:  # otherwise `reload` has checked the equations
            symbolic(self.layout, undisturbed=True)  # raises for faulty equations

    def _refuse_undeclared(self) -> None:
        """Raise BadInputError if a field of names contains an undeclared name."""
        named: dict[str, list[str]] = {"modes": [], "parts": []}
        for kind, names_in_groups in named.items():
            for group, members in getattr(self, kind).items():
                if isinstance(members, str) or not isinstance(members, Sequence):
                    raise BadInputError(
                        f"{self.name}: {kind} {shown(group)} is {shown(members)}; give a tuple of "
                        "names"
                    )
                names_in_groups += members
        schedule = [self.schedule] if self.schedule else []
        schedulable = [*self.states, *self.inputs, *self.parameters]
        for meaning, names, declared in (
            ("steady names the unknown state", self.steady, self.states),
            ("linear names the unknown state", self.linear, self.states),
            ("replaced names the unknown state", self.replaced, self.states),
            ("replaced names the unknown output", self.replaced.values(), self.outputs),
            ("schedule is the unknown variable", schedule, schedulable),
            ("modes names the unknown state", named["modes"], self.states),
            ("parts names the unknown linear state", named["parts"], self.linear),
            ("trim imposes the unknown variable", self.trim, self.holdable),
            ("domain.range names the unknown signal", self.domain.range, self.limits),
        ):
            for name in names:
                refuse_unknown(f"{self.name}: {meaning}", name, declared)

    def __repr__(self) -> str:
        counts = (
            f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        )
        return f"<Model {self.title}: {counts}>"

    def report(self) -> Report:
        """Return a report with tables of the signals: units, limits and trim values."""
        kinds = ("states", "inputs", "outputs", "parameters", "disturbances")
        signals = {kind: getattr(self, kind) for kind in kinds}
        return signals_report(self.title, signals, self.trim, self.about.notes)

    def __reduce__(self) -> Any:
        """Return the data from which pickle restores the model.

        The data are `source.reload` and its arguments if a function makes the model, and otherwise
        all fields.
        """
        if self.source.reload is None:
            return super().__reduce__()
        return self.source.reduced({name: p.start for name, p in self.parameters.items()})

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all that decides results: signals, rates, outputs, and declarations.

        Where the model has a file, its hash stands for what equations call and for functions of the
        declarations.
        """
        in_file = {"domain", "trimming", "about"} if self.source.digest else set()
        other = {"source", "equations"} | in_file
        declared = {
            each.name: getattr(self, each.name) for each in fields(self) if each.name not in other
        }
        vectors = self.layout.symbols(*VECTORS)
        *given, w = vectors
        results = map(ca.densify, self.layout.expressions(given, tuple(self.outputs), w))
        called = ca.Function.name if in_file else None
        graph = instructions(ca.Function("equations", vectors, [*results]), called)
        return fingerprint((declared, graph, self.source.digest))

    # Names and units.

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in order."""
        return tuple(self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(self.inputs)

    @property
    def title(self) -> str:
        """Name of the model in reports."""
        return self.about.title or self.name

    @property
    def subject(self) -> str:
        """Short name of the model in the first lines of reports."""
        return self.about.subject or self.title

    @property
    def schedule_unit(self) -> str:
        """Unit of the scheduling variable in reports. Angles are in degrees."""
        return "deg" if self.is_typed_in_degrees else self.unit(self.schedule)

    @property
    def is_typed_in_degrees(self) -> bool:
        """Whether scheduling values in radians are typed, shown and stored in degrees."""
        return self.unit(self.schedule) == "rad"

    @property
    def schedule_key(self) -> str:
        """Key of the scheduling variable in files and data, such as "dihedral_deg" or "speed"."""
        return f"{self.schedule}_deg" if self.schedule_unit == "deg" else self.schedule

    @cached_property
    def signals(self) -> dict[str, Signal]:
        """All states, inputs, outputs, parameters and disturbances of the model, name -> signal."""
        return {
            **self.states,
            **self.inputs,
            **self.outputs,
            **self.parameters,
            **self.disturbances,
        }

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables of a trim: states, or outputs that replace them, then inputs."""
        states = (self.replaced.get(name, name) for name in self.states)
        return (*states, *self.inputs)

    def state_places(self, names: Iterable[str]) -> list[int]:
        """Return the indices of the named states among all states."""
        places = []
        for name in names:
            refuse_unknown("unknown state", name, self.states)
            places.append(list(self.states).index(name))
        return places

    def input_places(self, names: Iterable[str]) -> list[int]:
        """Return the indices of the named inputs among all inputs."""
        places = []
        for name in names:
            refuse_unknown("unknown input", name, self.inputs)
            places.append(list(self.inputs).index(name))
        return places

    @cached_property
    def holdable(self) -> tuple[str, ...]:
        """Names of the quantities that a trim can impose: variables, outputs and airspeeds."""
        return tuple(dict.fromkeys((*self.variables, *self.outputs, *self.airspeeds)))

    @cached_property
    def airspeeds(self) -> dict[str, Signal]:
        """Airspeeds that a trim can impose in place of the speed, name -> signal.

        They are kcas, keas, ktas and mach of an aircraft with an altitude. An output with such a
        name is the model's own. The result is {} for other models.
        """
        if "altitude" not in recognized(self.states):
            return {}
        return {
            name: self.outputs.get(name, signal)
            for name, signal in AIRSPEEDS.items()
            if name in self.outputs or name not in self.signals
        }

    @cached_property
    def alternatives(self) -> tuple[tuple[str, ...], ...]:
        """Groups of names of which a trim imposes one, such as speed and mach."""
        if not self.airspeeds:
            return self.trimming.alternatives
        return ((recognized(self.states)["speed"], *self.airspeeds), *self.trimming.alternatives)

    def part(self, name: str) -> tuple[str, tuple[str, ...]]:
        """Return the output or state of a measured quantity, and the states that contribute to it.

        For a part of an output, only the states of this part contribute. Otherwise all linear
        states contribute.

        name: a state, an output, or a part of an output, OUTPUT_suffix (`Model.parts`)
        """
        for ending, states in self.parts.items():
            whole = name.removesuffix(f"_{ending}")
            if whole != name and whole in self.outputs:
                return whole, states
        return name, self.linear

    @cached_property
    def rates(self) -> dict[str, Signal]:
        """Rates of the states that a trim can impose, such as "speed_dot" -> signal.

        A rate is omitted if another signal has this name.
        """
        return {
            f"{name}_dot": Signal(self.rate_unit(name), self.rate_scale(name))
            for name in self.states
            if f"{name}_dot" not in self.signals
        }

    def without_alternatives(
        self, imposed: Mapping[str, Any], names: Iterable[str]
    ) -> dict[str, Any]:
        """Return the imposed values that can be imposed together with some other names.

        imposed: name -> value
        names: names that will also be imposed
        """
        released: set[str] = set()
        for group in self.alternatives:
            if not set(group).isdisjoint(names):
                released |= set(group).difference(names)
        return {name: value for name, value in imposed.items() if name not in released}

    def refuse_unheld(self, meaning: str, name: str, also: Sequence[str] = ()) -> None:
        """Raise BadInputError, with advice, unless a trim can impose a quantity.

        meaning: beginning of the message
        name: name of the quantity
        also: further permitted names
        """
        if name in self.rates or name in also:
            return
        if name in self.parameters:
            raise BadInputError(
                f"{meaning} {name!r}: a trim does not change this parameter; set it by "
                f"--hold {name}=VALUE or model.with_parameters({name}=VALUE)"
            )
        if name == ISA:
            raise BadInputError(
                f"{self.name} has air of its own, whose temperature {ISA} does not change; remove "
                f"{ISA}"
            )
        if name == "cg" and self.domain.reference:  # only a table of derivatives has a reference
            raise BadInputError(
                f"{self.name} has no center of gravity; add the line cg = 0.25 to its table: "
                "chords behind the leading edge, where its moments are given"
            )
        if name in self.holdable:
            return
        known = dict.fromkeys((*self.holdable, *also, *self.parameters))
        meant = meant_by(name, self.states)
        # A bank without a turn rate is no equilibrium: the usual trim holds the turn rate at 0.
        if meant == recognized(self.states).get("phi") and "turn_rate" in known:
            raise BadInputError(
                f"{meaning} {name!r}; give a level turn by --hold {meant}=ANGLE --free turn_rate"
            )
        if meant in known:
            raise BadInputError(f"{meaning} {name!r}; did you mean {meant}?")
        refuse_unknown(meaning, name, known)

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Limits of each state, input, output and disturbance, name -> (lowest, highest)."""
        return {
            name: (signal.min, signal.max)
            for name, signal in {**self.airspeeds, **self.signals}.items()
            if name not in self.parameters
        }

    def signal(self, name: str) -> Signal:
        """Return a signal, an airspeed or a rate. Raises BadInputError for an unknown name."""
        for known in (self.signals, self.airspeeds):
            if name in known:
                return known[name]
        refuse_unknown("unknown name", name, (*self.signals, *self.rates))
        return self.rates[name]

    def unit(self, name: str) -> str:
        """Return the unit of a signal, airspeed or rate, or raise BadInputError."""
        return self.signal(name).unit

    def units(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the units of the signals `names`, in their order."""
        return tuple(self.unit(name) for name in names)

    def nominal(self, names: Iterable[str]) -> np.ndarray:
        """Return the nominal values of the signals `names`, (k,), in their order."""
        return np.array([self.signal(name).nominal for name in names])

    @cached_property
    def time_unit(self) -> str:
        """Unit of time: the first of "s", "min", "h" and "day" in a declared unit, else "s"."""
        words = re.findall("[a-z]+", " ".join(signal.unit for signal in self.signals.values()))
        return next((unit for unit in ("s", "min", "h", "day") if unit in words), "s")

    def rate_unit(self, name: str) -> str:
        """Return the unit of a state's rate, such as ft/s for ft, and ft/s^2 for ft/s."""
        per_time = f"/{self.time_unit}"
        head, slash, power = self.unit(name).rpartition(per_time)
        if slash and (not power or power[1:].isdigit()):  # power: "" of ft/s, "^2" of ft/s^2
            return f"{head}{per_time}^{int(power[1:] or 1) + 1}"
        return f"{self.unit(name)}{per_time}"

    def rate_scale(self, name: str) -> float:
        """Return the typical magnitude of a state's rate, by default its nominal magnitude in 1 s.

        A model whose units contain no time may have any unit of time. There it is the largest
        change of the rate due to a nominal change of one state or input, at the start values.
        """
        refuse_unknown("unknown state", name, self.states)
        return self.states[name].rate or self._usual_rates[name]

    @cached_property
    def _usual_rates(self) -> dict[str, float]:
        """State -> typical magnitude of its rate, for states that declare none (`rate_scale`)."""
        nominal = {name: state.nominal for name, state in self.states.items()}
        words = re.findall("[a-z]+", " ".join(signal.unit for signal in self.signals.values()))
        if self.time_unit in words:
            per_time = conversion_factor("1/s", f"1/{self.time_unit}") or 1.0
            return {name: size * per_time for name, size in nominal.items()}
        # Without a unit of time, only the equations show how fast the states change.
        start = {name: signal.start for name, signal in self.signals.items()} | {**self.trim}
        x, u = ([start[name] for name in names] for names in (self.states, self.inputs))
        try:
            slopes = self.at(x, u)
        except (BadInputError, ArithmeticError):
            return nominal  # the equations fail at the start values
        changes = np.hstack([slopes.A, slopes.B]) * self.nominal((*self.states, *self.inputs))
        largest = np.abs(changes).max(axis=1).tolist()
        pairs = zip(nominal.items(), largest, strict=True)
        return {name: change or size for (name, size), change in pairs}  # size for a constant rate

    def factor_of(self, name: str, text: str, unit: str) -> float:
        """Return the factor from a stated unit to the unit of a signal, an airspeed or a rate.

        An airspeed may repeat its name (250 KCAS).

        text: the value as stated, for the message
        unit: the stated unit

        Raises BadInputError, whose message completes a sentence that begins with the name, if the
        unit is another quantity's.
        """
        if name in self.airspeeds and unit.lower() == name:
            return 1.0
        return factor_to(self.signal(name), text, unit)

    def number(self, name: str, value: Any) -> Any:
        """Return a value of a signal, an airspeed or a rate in the unit of the model.

        value: a number, which is returned unchanged, or text with a unit: "250 kt", "FL200"

        Raises BadInputError for text that is not a number with a unit of this quantity.
        """
        if not isinstance(value, str):
            return value
        digits, unit = split_unit(value)
        try:
            number = float(digits)
        except ValueError:
            number = math.nan
        if not (unit and math.isfinite(number)):
            raise BadInputError(
                f'{name} is {shown(value)}; give a number, or text with a unit ("250 kt", "5 deg")'
            )
        try:
            return number * self.factor_of(name, value, unit)
        except BadInputError as error:
            raise BadInputError(f"{name} {error}") from error

    def entry_unit(self, row: str, column: str) -> str:
        """Return the unit of an entry of A or B.

        row: state whose rate is differentiated
        column: state or input with respect to which the rate is differentiated
        """
        return f"({self.rate_unit(row)})/({self.unit(column)})"

    def describe(self, name: str, value: float) -> str:
        """Return a value of the signal `name` with its unit as text. Angles are in degrees."""
        signal = self.signal(name)
        return with_unit(value, signal.unit, signal.nominal)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on data that are probably wrong, with the parameters as they are."""
        native = self.native
        about = native.about
        if about.warnings_about is None:
            return about.warnings
        values = dict(zip(native.parameters, native.p.tolist(), strict=True))
        return (*about.warnings, *about.warnings_about(values))

    @property
    def native(self) -> Model:
        """The model in its declared units: the original of a converted model, or the model."""
        return self.source.native or self

    @property
    def changed(self) -> dict[str, float]:
        """Parameters that are not as the model was loaded: name -> value as loaded."""
        native = self.native
        return {
            name: value * self.native_factor(name)
            for name, value in native.source.declared.items()
            if native.parameters[name].start != value
        }

    def native_factor(self, name: str) -> float:
        """Return the factor from a signal's unit in the original model to its unit in this one."""
        return conversion_factor(self.native.unit(name), self.unit(name)) or 1.0

    def native_values(self, names: Sequence[str], values: ArrayLike) -> np.ndarray:
        """Return values of signals in the units that the original model declares.

        values: values in the units of this model, (..., names)
        """
        given = np.asarray(values, dtype=float)
        if given.shape[-1:] != (len(names),):
            raise BadInputError(f"values has shape {given.shape}; give {len(names)} in each row")
        if self.native is self:  # all factors are 1
            return given
        return given / [self.native_factor(name) for name in names]

    # Parameters.

    def with_parameters(self, **values: float | str) -> Model:
        """Return a copy of the model with other values of parameters.

        values: parameter -> number in the unit of the model, or text with a unit: mass="2000 lbm"

        Raises BadInputError for an unknown parameter or a value beyond its limits.
        """
        changed = dict(self.parameters)
        for name, given in values.items():
            refuse_unknown(f"{self.name} has no parameter", name, tuple(self.parameters))
            signal = self.parameters[name]
            value = self.number(name, given)
            if not is_finite(value):
                raise BadInputError(f"{name} is {shown(value)}; give a finite number")
            if not signal.min <= value <= signal.max:
                which, limit = ("most", signal.max) if value > signal.max else ("least", signal.min)
                # A lever in angles: with full = 25, flap=25deg is 1.
                angle = f", or an angle: {name}={signal.full:g}deg" if signal.full else ""
                raise BadInputError(
                    f"{name} is {self.describe(name, value)}; give at {which} "
                    f"{self.describe(name, limit)}{angle}"
                )
            changed[name] = signal._replace(start=float(value))
        native = self.source.native
        if native is not None:  # a model in SI units changes with its original
            of_native = {name: changed[name].start / self.native_factor(name) for name in values}
            native = native.with_parameters(**of_native)
        # A value that was changed before keeps its first one as the declared value.
        declared = {name: self.parameters[name].start for name in values} | {**self.source.declared}
        source = replace(self.source, native=native, declared=declared)
        return replace(self, parameters=changed, source=source)

    @cached_property
    def p(self) -> np.ndarray:
        """Values of the parameters, in order."""
        return np.array([signal.start for signal in self.parameters.values()], dtype=float)

    # Values and derivatives.

    @cached_property
    def layout(self) -> Layout:
        """Equations and signal names of the model, without the values of its parameters."""
        # Models that differ only in values have equal layouts, and share compiled functions.
        groups = (self.states, self.inputs, self.parameters, self.disturbances, self.outputs)
        names, replaced = SignalNames(*map(tuple, groups)), tuple(self.replaced.items())
        return Layout(self.name, self.equations, names, replaced, self.variables, self.linear)

    def functions(self, outputs: Sequence[str] | None = None) -> ca.Function:
        """Return the CasADi function (x, u, p) -> fields of a `Linearization`, at w = 0.

        outputs: names of outputs or states, by default all outputs
        """
        chosen = tuple(self.outputs if outputs is None else outputs)
        for name in chosen:
            refuse_unknown("unknown output", name, (*self.outputs, *self.states))
        return linearized(self.layout, chosen, ())

    def at(
        self, x: Any, u: Any, outputs: Sequence[str] = (), disturbances: Sequence[str] = ()
    ) -> Linearization:
        """Return the rates f, the outputs y and their derivatives at a point, exact up to rounding.

        x: state, (n,)
        u: input, (m,)
        outputs: names of outputs or states
        disturbances: names of the disturbances in w

        Raises BadInputError for vectors of another length and as `linearized` does, and
        NotFiniteError if a result is not finite.
        """
        self.refuse_vectors(x, u)
        known = (*self.outputs, *self.states)
        for name in outputs:
            refuse_unknown("unknown output", name, known)
        rows = linearized_rows(self.layout, tuple(outputs), tuple(disturbances))
        # One row of arguments gives one result, which has one row: all fields one after the other.
        ((flat,),) = rows(*(np.asarray(vector)[None] for vector in (x, u, self.p)))
        n, m, k, d = len(self.states), len(self.inputs), len(outputs), len(disturbances)
        if not np.isfinite(flat).all():
            values = dict(zip((*self.states, *self.inputs), (*x, *u), strict=True))
            raise NotFiniteError(self.message_of_not_finite(flat[:n], values))
        shapes = ((n,), (k,), (n, n), (n, m), (k, n), (k, m), (n, d), (k, d))
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        parts = zip(np.split(flat, ends[:-1]), shapes, strict=True)
        return Linearization(*(part.reshape(shape) for part, shape in parts))

    def message_of_not_finite(self, rates: np.ndarray, values: Mapping[str, float]) -> str:
        """Return the error message for a rate or derivative that is not finite.

        The message contains the values at the point, unless the equations contain the constant NaN.

        rates: rates at the point, (n,)
        values: state or input -> value at the point
        """
        pairs = zip(self.states, rates, strict=True)
        wrong = [name for name, rate in pairs if not math.isfinite(rate)]
        what = f"the rate of {wrong[0]}" if wrong else "a derivative"
        if self.layout.has_nan:
            return f"{self.name}: {what} contains NaN; use CasADi's functions (ca.sin), not math's"
        where = ", ".join(f"{self.describe(name, value)} {name}" for name, value in values.items())
        if fault := self.about.failed():
            return f"{self.name}: {fault} (at {where})"
        return (
            f"{self.name}: {what} is not a number at {where}; begin elsewhere, by start= of a "
            f"Signal or --start {next(iter(values))}=VALUE, or correct equations or parameters"
        )

    def outputs_at(
        self, x: Sequence[float], u: Sequence[float], names: Sequence[str] | None = None
    ) -> dict[str, float]:
        """Return the outputs at a state and an input, without disturbance, name -> value.

        x: state, (n,)
        u: input, (m,)
        names: names of outputs, by default all
        """
        for name in names or ():
            refuse_unknown("unknown output", name, self.outputs)
        _, outputs = self._numbers_at(x, u)
        return {name: float(outputs[name]) for name in (self.outputs if names is None else names)}

    def rates_at(self, x: Sequence[float], u: Sequence[float]) -> dict[str, float]:
        """Return the rates at a state and an input, without disturbance, state -> rate.

        x: state, (n,)
        u: input, (m,)
        """
        rates, _ = self._numbers_at(x, u)
        return {name: float(rates[name]) for name in self.states}

    def refuse_vectors(self, x: Any, u: Any) -> None:
        """Raise BadInputError unless x is (n,) and u (m,)."""
        for vector, values, names in (("x", x, self.states), ("u", u, self.inputs)):
            shape = numbers_in(vector, values).shape
            if shape != (len(names),):
                raise BadInputError(f"{vector} has shape {shape}; give {len(names)} numbers")

    def _numbers_at(
        self, x: Sequence[float], u: Sequence[float]
    ) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return rates and outputs by name at x (n,) and u (m,), without disturbance."""
        self.refuse_vectors(x, u)
        numbers = [[float(value) for value in vector] for vector in (x, u, self.p)]
        still_air = [0.0 for _ in self.disturbances]
        groups = zip(self.layout.names[:4], (*numbers, still_air), strict=True)  # x, u, p and w
        records = [record(names)(*values) for names, values in groups]
        try:
            return self.equations(*records)
        except (RuntimeError, ArithmeticError):
            # Some CasADi functions (pw_lin) accept only symbols, and numbers in Python raise
            # exceptions for which CasADi returns inf or nan.
            f, y = self.functions()(*numbers)[:2]
            rates = dict(zip(self.states, ca.vertsplit(f), strict=True))
            return rates, dict(zip(self.outputs, ca.vertsplit(y), strict=True))
