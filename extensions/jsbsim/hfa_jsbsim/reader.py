"""Conversion of a JSBSim aircraft to a `Model`: files, names, units, limits and initial values."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.about import About, Domain, Source, Trimming
from hfa_aircraft.layout import column
from hfa_aircraft.model import Model
from hfa_aircraft.rigid.aircraft import (
    DEVIATION,
    STATES,
    inertia_matrix,
    inertia_warning,
)
from hfa_aircraft.rigid.atmosphere import SEA_LEVEL, air_at
from hfa_aircraft.signals import ISA, Signal, usual_begin, usual_modes
from hfa_jsbsim.accounting import notes_on_omitted, of_engine_files, refuse_unsupported
from hfa_jsbsim.aircraft import GUSTS, LEVERS, WINDS, Equations
from hfa_jsbsim.aircraft_files import choices_of, find_aircraft
from hfa_jsbsim.airframe import SLUG_TO_LB
from hfa_jsbsim.engines import EngineFile
from hfa_jsbsim.equations import EquationsOfMotion
from hfa_jsbsim.parts import Parts
from hfa_jsbsim.properties import FORCE, Note, grouped, key_of, symbols_of
from hfa_support.errors import BadInputError, shortened

#: Outputs that are surface positions: name -> property, in rad.
_POSITIONS = {
    "elevator_position": "fcs/elevator-pos-rad",
    "left_aileron_position": "fcs/left-aileron-pos-rad",
    "right_aileron_position": "fcs/right-aileron-pos-rad",
    "rudder_position": "fcs/rudder-pos-rad",
}
#: JSBSim's property -> name in the model. Values are converted as typed ones are, with angles in
#: degrees.
ALIASES = {
    "velocities/vc-kts": "kcas",
    "velocities/mach": "mach",
    "velocities/vt-fps": "speed",
    "velocities/vtrue-fps": "speed",
    "aero/alpha-deg": "alpha",
    "aero/beta-deg": "beta",
    "attitude/phi-deg": "roll",
    "attitude/theta-deg": "pitch",
    "attitude/psi-deg": "yaw",
    "flight-path/gamma-deg": "gamma",
    "position/h-sl-ft": "altitude",
    "fcs/aileron-cmd-norm": "aileron",
    "fcs/elevator-cmd-norm": "elevator",
    "fcs/rudder-cmd-norm": "rudder",
    "fcs/throttle-cmd-norm": "throttle",
    "fcs/flap-cmd-norm": "flap",
    "fcs/speedbrake-cmd-norm": "speedbrake",
    "fcs/spoiler-cmd-norm": "spoiler",
    "fcs/pitch-trim-cmd-norm": "pitch_trim",
    "fcs/roll-trim-cmd-norm": "roll_trim",
    "fcs/yaw-trim-cmd-norm": "yaw_trim",
    "gear/gear-cmd-norm": "gear",
}
#: Property that is an argument of tables -> name in the model, and factor to its unit.
_ARGUMENTS = {
    "aero/alpha-rad": ("alpha", 1.0),
    "aero/alpha-deg": ("alpha", math.pi / 180.0),
    "velocities/mach": ("mach", 1.0),
    "aero/qbar-psf": ("dynamic_pressure", 1.0),
}
#: Initial advance ratio V / (n D) in the search for a propeller's speed.
_ADVANCE_RATIO = 0.72
#: Number of speeds at which the windmilling speed of a propeller is searched, and the largest,
#: relative to the usual speed.
_SPEEDS_TRIED = 121
_FASTEST = 3.0
#: Number of nodes from which common subexpressions are not searched (`ca.cse`), because their table
#: would be too large.
_TOO_LARGE_FOR_CSE = 200_000


def read_model(text: str) -> Model:
    """Return the `Model` of "jsbsim:NAME" or of an aircraft's XML file.

    Options may follow a question mark: "jsbsim:737?engines=states&throttles=each". With
    "inputs=fcs/a,fcs/b", these properties are inputs in addition to the pilot's commands; "folder="
    names the folder of the aircraft's other files.

    Raises BadInputError for an unknown aircraft or option, and, with file and line, for an element
    that is not supported.
    """
    name, _, chosen = text.partition("?")
    choices = choices_of(chosen)
    path, folders = find_aircraft(name, choices.folder)
    parts = Parts(path, folders, choices)
    for root in folders.documents:
        refuse_unsupported(root)
    equations = Equations(parts)
    declaration = _Declaration(parts, equations)
    notes = [*equations.notes, *notes_on_omitted(parts, equations)]
    return declaration.model(Source(text, folders.digest), notes)


class _Arguments(NamedTuple):
    """Arguments of an aircraft's function, and the symbols that are not among them.

    vectors: x, u and p as columns of symbols
    left_out: symbols without an effect on the forces
    constants: values that replace them
    """

    vectors: list[ca.SX]
    left_out: ca.SX
    constants: ca.SX


class _Declaration:
    """Signals, trim condition and further declarations of an aircraft's `Model`."""

    def __init__(self, parts: Parts, equations: Equations) -> None:
        self.parts = parts
        self.equations = equations
        used = equations.used_symbols()
        self.inputs = equations.used_inputs()
        for full_name, name in equations.chosen.items():
            if name not in self.inputs:
                raise BadInputError(
                    f"{parts.path}: inputs={shortened(full_name)}: no force depends on this "
                    "property, or a component sets it; remove it from ?inputs="
                )
        self.parameters = {
            name: symbol
            for name, symbol in equations.parameters.items()
            if name == "gravity" or symbol.element_hash() in used
        }
        pressure = parts.mass.weight / max(parts.wings.area, 1e-6)
        #: True airspeed at sea level for a lift coefficient of 0.5, ft/s.
        self.usual_speed = math.sqrt(2.0 * pressure / (SEA_LEVEL.density * 0.5))

    def _add_outputs(self, equations: Equations) -> None:
        """Add positions of surfaces that pilot commands move, and differences of throttles."""
        for name in self._positions():
            position = equations.properties.read(_POSITIONS[name], "")
            equations.outputs[name] = equations.resolved(position)
        for name, (first, second) in self._splits().items():
            u = equations.inputs
            equations.outputs[name] = u[second].symbol - u[first].symbol

    def model(self, source: Source, notes: list[Note]) -> Model:
        """Return the model of the aircraft."""
        self._add_outputs(self.equations)
        states = self._states()
        outputs = self._outputs()
        equations_of_motion = self._equations(list(outputs))
        self._refuse_time()
        linear = tuple(name for name in states if name not in ("yaw", "altitude"))
        # The acceleration of a spool is limited nearly everywhere. A trim therefore balances its
        # speed error.
        steady = tuple(name for name in linear if not name.startswith("spool"))
        configuration = self._configuration()
        left_out = grouped(note for note in notes if note.rank == FORCE)
        aliases = ALIASES | self._own_aliases()
        short_aliases = {name.rpartition("/")[2]: own for name, own in aliases.items()}  # vc-kts
        return Model(
            self.parts.name,
            states,
            self._inputs(),
            equations_of_motion,
            parameters=self._parameters(),
            disturbances=dict.fromkeys(GUSTS, Signal("ft/s", 10.0)),
            outputs=outputs,
            trim=self._trim(),
            steady=steady,
            linear=linear,
            schedule="speed",
            modes=usual_modes(states) | self._engine_modes(),
            source=source,
            domain=Domain(self._table_ranges()),
            about=About(
                notes=(*grouped(notes),),
                aliases=short_aliases | aliases,
                warnings_about=partial(self._warnings, configuration, left_out),
                equations="JSBSim",
                atmosphere="U.S. Standard 1976",
                configuration=configuration,
            ),
            trimming=Trimming(
                alternatives=tuple(  # an imposed throttle replaces a split
                    (throttle, name) for name, pair in self._splits().items() for throttle in pair
                ),
                begin=self._start_of_search(),
            ),
        )

    def _refuse_time(self) -> None:
        """Raise BadInputError if a rate depends on the time where a trim search begins."""
        named = (self._states(), self._inputs(), self._parameters())
        begin = ([signal.start for signal in signals.values()] for signals in named)
        rates, _ = self._in_still_air(*begin)
        if self.equations.fault_of_time and not rates.is_regular():
            raise BadInputError(self.equations.fault_of_time)

    def _warnings(
        self,
        configuration: Callable[..., dict[str, tuple[float, str]]],
        left_out: list[str],
        parameters: Mapping[str, float],
    ) -> Iterator[str]:
        """Yield a sentence if no rigid body has the inertias, and if no throttle moves a thrust,
        after the notes on what is left out and moves a force.
        """
        yield from left_out
        p = [*parameters.values()]
        x = [signal.start for signal in self._states().values()]
        values = configuration(x, [0.0] * len(self.inputs), p)
        xx, yy, zz, xz = (values[name][0] for name in ("Ixx", "Iyy", "Izz", "Ixz"))
        inertia = inertia_matrix((xx, yy, zz), (0.0, xz, 0.0))
        yield from dict.fromkeys(of_engine_files(self.parts))
        yield from filter(None, (inertia_warning(inertia), self._warning_of_throttle(x, p)))

    def _warning_of_throttle(self, x: list[float], p: list[float]) -> str:
        """Return a sentence if no throttle changes a rate, for states x and parameters p."""
        throttles = self._throttles()
        idle, full = (
            self._in_still_air(x, [end * (name in throttles) for name in self.inputs], p)
            for end in (0.0, 1.0)
        )
        is_idle = bool(throttles) and ca.is_equal(idle[0], full[0])  # [0]: the rates
        return "the throttle moves no thrust" * is_idle

    def _configuration(self) -> Callable[..., dict[str, tuple[float, str]]]:
        """Return the function (x, u, p) -> mass, center of gravity, inertias, sizes with units."""
        equations = self.equations
        mass = equations.mass
        inertia = mass.inertia
        values = {
            "mass": (mass.slugs, "slug"),
            **{f"center_of_gravity_{axis}": (mass.center[k], "in") for k, axis in enumerate("xyz")},
            "Ixx": (inertia[0, 0], "slug ft^2"),
            "Iyy": (inertia[1, 1], "slug ft^2"),
            "Izz": (inertia[2, 2], "slug ft^2"),
            "Ixz": (-inertia[0, 2], "slug ft^2"),  # the product of inertia ∫ x z dm
            "reference_area": (self.parts.wings.area, "ft^2"),
            "reference_span": (self.parts.wings.span, "ft"),
            "reference_chord": (self.parts.wings.chord, "ft"),
        }
        arguments = self._arguments(equations)
        expressions = equations.resolved(ca.vertcat(*(value for value, _ in values.values())))
        values_at = ca.substitute(expressions, arguments.left_out, arguments.constants)
        function = ca.Function("configuration", arguments.vectors, [values_at])

        def configuration(x: Any, u: Any, p: Any) -> dict[str, tuple[float, str]]:
            """Return name -> (value, unit)."""
            numbers = np.asarray(function(x, u, p)).ravel().tolist()
            units = (unit for _, unit in values.values())
            return dict(zip(values, zip(numbers, units, strict=True), strict=True))

        return configuration

    def _table_ranges(self) -> dict[str, tuple[float, float, str]]:
        """Return the ranges of tables over alpha, Mach number and dynamic pressure, by name."""
        ranges: dict[str, tuple[float, float, str]] = {}
        for full_name, (name, factor) in _ARGUMENTS.items():
            if full_name in self.equations.properties.ranges:
                low, high = (factor * end for end in self.equations.properties.ranges[full_name])
                before = ranges.get(name, (low, high, ""))
                ends = min(low, before[0]), max(high, before[1])  # alpha is read in rad and in deg
                ranges[name] = (*ends, "the range of the tables")
        return ranges

    def _own_aliases(self) -> dict[str, str]:
        """Return JSBSim's name -> signal, of tanks, point masses, wind and chosen inputs."""
        names = self.equations.chosen | self.equations.constants
        for axis, name in zip(("north", "east", "down"), WINDS, strict=True):
            names[f"atmosphere/wind-{axis}-fps"] = name
        for number in range(len(self.parts.tanks)):
            names[f"propulsion/tank[{number}]/contents-lbs"] = f"tank{number}"
        for number in range(len(self.parts.points)):
            names[f"inertia/pointmass-weight-lbs[{number}]"] = f"pointmass{number}"
        # JSBSim also accepts tank for tank[0].
        without_zero = {full_name.replace("[0]", ""): name for full_name, name in names.items()}
        known = {*self.parameters, *self.inputs}
        both = names | without_zero
        return {full_name: name for full_name, name in both.items() if name in known}

    def _states(self) -> dict[str, Signal]:
        """Return the signals of the states, by name."""
        # Signal(unit, nominal, min, max, start, rate)
        angle = Signal("rad", 0.1, -3.1, 3.1)
        rate = Signal("rad/s", 0.1, rate=1.0)
        signals = {
            "speed": Signal(
                "ft/s", self.usual_speed, 1.0, 10000.0, self.usual_speed, rate=SLUG_TO_LB
            ),
            "alpha": Signal("rad", 0.1, -0.4, 0.7, 0.05),
            "beta": Signal("rad", 0.1, -0.6, 0.6),
            **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), rate),
            "roll": angle,
            "pitch": Signal("rad", 0.1, -1.55, 1.55, 0.05),
            "yaw": Signal("rad", 0.1),
            "altitude": Signal("ft", 10000.0, -1000.0, 150000.0, 5000.0),
        }
        ordered = {name: signals[name]._replace(assumed=True) for name in STATES}
        for file in self.parts.engines:
            if file.has_propeller:
                is_single = len(self.parts.engines) == 1
                ordered[f"rpm{file.number}"] = self._rpm(file, is_single)
            if file.governed:
                lowest = file.thruster.value_of("minpitch", 0.0)
                highest = file.thruster.value_of("maxpitch", 0.0)
                middle = 0.5 * (lowest + highest)
                ordered[f"blade{file.number}"] = Signal("deg", 5.0, lowest, highest, middle, 100.0)
            if file.lag in self.equations.states:
                unit, size = ("inHg", 3.0) if file.kind == "piston_engine" else ("%", 10.0)
                ordered[file.lag] = Signal(unit, size, 0.0, start=file.usual_lag)
        filters = [state.symbol.name() for state in self.equations.properties.filters]
        return ordered | dict.fromkeys(filters, Signal())

    def _rpm(self, file: EngineFile, is_single: bool) -> Signal:
        """Return the signal of a propeller's speed, without a highest speed.

        is_single: whether the aircraft has one engine
        """
        # One of several engines may stand still. A single engine runs, also a little below idle.
        lowest = 10.0 if is_single else 0.0
        if is_single and file.kind == "piston_engine":
            lowest = 0.8 * file.engine.value_of("idlerpm", 600.0) / file.gear_ratio
        usual = _stated_speed(file) or _usual_propeller_speed(file, self.usual_speed)
        return Signal("rpm", 0.1 * usual, lowest, start=0.9 * usual, rate=usual)

    def _inputs(self) -> dict[str, Signal]:
        """Return the signals of the inputs, by name."""
        signals = {}
        for name, pilot_input in self.inputs.items():
            is_throttle = name.startswith("throttle")
            start = self.equations.starts.get(name, 0.6 if is_throttle else 0.0)
            note = self._note_on_engines(name) if is_throttle else self._note_on_kinematics(name)
            signals[name] = Signal(  # unit, nominal, min, max, start
                pilot_input.unit, 0.1, *pilot_input.limits, start, omitted_dynamics=note
            )
        return signals

    def _note_on_kinematics(self, name: str) -> str:
        """Return a note that an input moves <kinematic>s without their travel times, or ""."""
        symbol = self.inputs[name].symbol
        components = [
            component
            for component, value in self.equations.properties.travels
            if ca.depends_on(value, symbol)
        ]
        if not components:
            return ""
        names = ", ".join(
            shortened(component.attributes.get("name", "")) for component in components
        )
        return f"{name} moves, and <kinematic> {names} follows without its travel time"

    def _note_on_engines(self, throttle: str) -> str:
        """Return a note on engines that follow a throttle without their lag, or ""."""
        number = throttle.removeprefix("throttle")
        lags = [file.lag for file in self.parts.engines if number in ("", str(file.number))]
        left_out = [lag for lag in lags if lag and lag not in self.equations.states]
        if not left_out:
            return ""
        return (
            f"{throttle} moves, and engines follow without delay; ?engines=states after the"
            " aircraft's"
            f" name makes their lags states ({', '.join(left_out)})"
        )

    def _parameters(self) -> dict[str, Signal]:
        """Return the signals of the parameters, by name."""
        # Signal(unit, nominal, min, max, start)
        known = dict.fromkeys(WINDS, Signal("ft/s", 10.0)) | {ISA: DEVIATION}
        known["gravity"] = Signal("ft/s^2", 32.0, start=SLUG_TO_LB)
        for lever in (*LEVERS, "mixture", "advance"):
            if lever in self.parameters:
                lowest = -1.0 if lever.endswith("_trim") else 0.0
                start = 0.0 if lever in LEVERS else 1.0
                full = self._angle_at_full(lever)
                known[lever] = Signal(min=lowest, max=1.0, start=start, full=full)
        for number, tank in enumerate(self.parts.tanks):
            known[f"tank{number}"] = Signal("lbf", 100.0, 0.0, tank.capacity, tank.contents)
        for number, point in enumerate(self.parts.points):
            known[f"pointmass{number}"] = Signal("lbf", 100.0, start=point.weight)
        for file in self.parts.engines:
            known[f"engine{file.number}"] = Signal(min=0.0, max=1.0, start=1.0)
            known[f"feather{file.number}"] = Signal(min=0.0, max=1.0)
        signals = {}
        for name in self.parameters:  # the others are constants of the files
            signal = known.get(name, Signal())
            signals[name] = signal._replace(start=self.equations.starts.get(name, signal.start))
        return signals

    def _angle_at_full(self, lever: str) -> float:
        """Return the surface position, deg, at the lever position 1, or 0 if not proportional."""
        properties, symbol = self.equations.properties, self.parameters[lever]
        name = f"fcs/{lever}-pos-deg"
        if properties.writer(name) is None:
            return 0.0
        position = self.equations.resolved(properties.read(name, ""))
        if symbols_of(position) - {key_of(symbol)}:  # it depends on other signals too
            return 0.0
        at_half, at_full = (float(ca.substitute(position, symbol, end)) for end in (0.5, 1.0))
        return at_full if at_full > 0.0 and 2.0 * at_half == at_full else 0.0

    def _outputs(self) -> dict[str, Signal]:
        """Return the signals of the outputs, by name."""
        angles = ("gamma", "angle_of_attack", "track", *self._positions())
        tenth = 0.1 * self.parts.mass.weight
        signals = {
            "kcas": Signal("kt", 100.0),
            "mach": Signal("1", 0.5),
            "turn_rate": Signal("rad/s", 0.1),
            **dict.fromkeys(("load_factor", "lift_to_weight"), Signal()),
            **dict.fromkeys(angles, Signal("rad", 0.1)),
            **dict.fromkeys(("thrust", "weight", "lift", "drag"), Signal("lbf", tenth)),
            "pitching_moment": Signal("ft lbf", tenth),
            "dynamic_pressure": Signal("lbf/ft^2", 100.0),
            "reference_area": Signal("ft^2"),
            "reference_chord": Signal("ft"),
            "ground_speed": Signal("ft/s", 100.0),
            **dict.fromkeys(self._spool_errors(), Signal("%", 10.0)),
            **dict.fromkeys(self._splits(), Signal("1", 0.5)),
        }
        power = Signal("hp", 100.0)
        return {name: signals.get(name, power) for name in self.equations.outputs}

    def _start_of_stopped_engines(self, values: Mapping[str, Any]) -> dict[str, float]:
        """Return initial values of propeller speeds and blade angles of engines that do not run."""
        # An engine does not run if it is off or without fuel. The initial speed is the windmilling
        # speed, or 0. The result is empty for an array of several airspeeds.
        if np.size(values["speed"]) > 1:
            return {}
        stopped = [
            file
            for file in self.parts.engines
            if file.has_propeller and (file.dry_of or values.get(f"engine{file.number}") == 0.0)
        ]
        initial: dict[str, float] = {}
        for file in stopped:
            blade = {}
            if file.governed:
                blade_stop = "maxpitch" if values.get(f"feather{file.number}") else "minpitch"
                blade[f"blade{file.number}"] = file.thruster.value_of(blade_stop, 0.0)
            initial |= blade
            initial[f"rpm{file.number}"] = self._equilibrium_speed(file, {**values, **blade})
        return initial

    def _equilibrium_speed(self, file: EngineFile, values: Mapping[str, Any]) -> float:
        """Return the highest equilibrium speed of a propeller, rpm, or 0 if none exists.

        Speeds up to `_FASTEST` times the initial speed are searched. If the propeller does not slow
        down at this limit, the limit is returned.
        """
        name = f"rpm{file.number}"
        signals = (self._states(), self._inputs(), self._parameters())
        columns = [[values.get(key, named[key].start) for key in named] for named in signals]
        row = list(self.equations.rates).index(name)  # also that of the state

        def rates(speeds: np.ndarray) -> np.ndarray:
            """Return the acceleration of the propeller at speeds (N,), rpm/s."""
            tables = [np.tile(np.reshape(column, (-1, 1)), len(speeds)) for column in columns]
            states, *_ = tables
            states[row] = speeds
            derivatives, *_ = self._in_still_air.map(len(speeds)).call(tables)
            return np.asarray(derivatives)[row]

        fastest = _FASTEST * self._rpm(file, is_single=False).start
        speeds = fastest * np.linspace(1.0, 0.0, _SPEEDS_TRIED) ** 2  # finer near 0
        (not_slowing,) = np.nonzero(rates(speeds) >= 0.0)
        if len(not_slowing) == 0 or (first := not_slowing[0]) == 0:
            return fastest if len(not_slowing) else 0.0
        from scipy.optimize import brentq

        return float(brentq(lambda rpm: rates(np.array([rpm]))[0], *speeds[first - 1 : first + 1]))

    def _equations(self, outputs: list[str]) -> EquationsOfMotion:
        """Return the equations of motion with and without gusts."""

        @cache
        def gusty() -> ca.Function:
            """Return the function with gusts, built when the first gust is not 0."""
            equations = Equations(self.parts, gusty=True)
            self._add_outputs(equations)
            return self._function(equations, outputs, list(equations.gusts.values()))

        self._in_still_air = self._function(self.equations, outputs)
        return EquationsOfMotion(self._in_still_air, gusty, list(self.equations.rates), outputs)

    def _function(
        self, equations: Equations, outputs: list[str], gusts: list[ca.SX] | None = None
    ) -> ca.Function:
        """Return a CasADi function (x, u, p) or (x, u, p, gusts) -> (time derivatives, outputs)."""
        rates = ca.vertcat(*equations.rates.values())
        others = ca.vertcat(*(equations.outputs[name] for name in outputs))
        arguments = self._arguments(equations)
        vectors = arguments.vectors
        if gusts is not None:
            vectors = [*vectors, ca.vertcat(*gusts)]
        values = ca.substitute([rates, others], [arguments.left_out], [arguments.constants])
        if ca.n_nodes(ca.vertcat(*values)) < _TOO_LARGE_FOR_CSE:
            values = ca.cse(values)
        values = [ca.densify(part) for part in values]
        return ca.Function("jsbsim", vectors, values)

    def _arguments(self, equations: Equations) -> _Arguments:
        """Return the arguments x, u and p of the aircraft's functions."""
        # Inputs and parameters without an effect are replaced by constants: their values in the
        # files, 0, or 1 for the switch of an engine, which is on. Commands that surface positions
        # replace as inputs are 0 in the filters that they still reach.
        unused = {name: pilot_input.symbol for name, pilot_input in equations.inputs.items()}
        u = [unused.pop(name) for name in self.inputs]
        unused |= equations.parameters
        p = [unused.pop(name) for name in self.parameters]
        starts = self.equations.starts
        constants = [1.0 if name.startswith("engine") else starts.get(name, 0.0) for name in unused]
        zeros = [*equations.rate_symbols, *equations.replaced_commands]
        left_out = [*unused.values(), *zeros]
        constants += [0.0] * len(zeros)
        vectors = [column(equations.states.values()), column(u), ca.vertcat(*p)]
        return _Arguments(vectors, column(left_out), ca.SX(constants))

    def _trim(self) -> dict[str, float]:
        """Return the default trim condition, straight level flight, as name -> imposed value."""
        # - The flight path angle is free if there is no throttle or no engine has fuel.
        # - Without fuel, all throttles are 0. Otherwise all are equal.
        # - The sideslip is free unless both aileron and rudder are inputs.
        imposed = {"speed": self.usual_speed, "altitude": 5000.0, "yaw": 0.0, "turn_rate": 0.0}
        throttles = self._throttles()
        if all(file.dry_of for file in self.parts.engines):
            imposed |= dict.fromkeys(throttles, 0.0)
        elif throttles:
            imposed["gamma"] = 0.0
            imposed |= dict.fromkeys(self._splits(), 0.0)
        if {"aileron", "rudder"} <= set(self.inputs):
            imposed["beta"] = 0.0
        starts = self.equations.starts
        commands = self.equations.constants.values()  # of the files, that are inputs
        imposed |= {name: starts[name] for name in commands if name in self.inputs}
        return imposed | dict.fromkeys(self._spool_errors(), 0.0)

    def _positions(self) -> Iterator[str]:
        """Yield the names of outputs that are positions of surfaces moved by pilot commands."""
        for name, full_name in _POSITIONS.items():
            command = name.removesuffix("_position").removeprefix("left_").removeprefix("right_")
            is_set = self.equations.properties.writer(full_name) is not None
            # Its unit is rad if the surface position itself is the input.
            if is_set and command in self.inputs and self.inputs[command].unit == "1":
                yield name

    def _throttles(self) -> list[str]:
        """Return the names of the inputs that are throttles."""
        return [name for name in self.inputs if name.startswith("throttle")]

    def _splits(self) -> dict[str, tuple[str, str]]:
        """Return the outputs that compare throttles of neighboring engines, name -> throttles."""
        pairs = pairwise(self._throttles())
        return {f"throttle_split{number}": pair for number, pair in enumerate(pairs)}

    def _spool_errors(self) -> list[str]:
        """Return the names of the outputs that are spool errors of turbines."""
        return [name for name in self.equations.outputs if name.startswith("spool_error")]

    def _engine_modes(self) -> dict[str, tuple[str, ...]]:
        """Return the modes of propellers, governors and engine lags, as name -> states."""
        modes: dict[str, tuple[str, ...]] = {}
        for file in self.parts.engines:
            if file.has_propeller:
                modes[f"propeller {file.number}"] = (f"rpm{file.number}",)
            if file.governed:
                modes[f"governor {file.number}"] = (f"blade{file.number}",)
            if file.lag in self.equations.states:
                modes[f"{file.lag.rstrip('0123456789')} {file.number}"] = (file.lag,)
        return modes

    def _start_of_search(self) -> Callable[[Mapping[str, Any]], Mapping[str, Any]]:
        """Return the function imposed values -> initial values of a trim search, by name."""
        # The angle of attack follows from the lift coefficient of level flight, and bank and body
        # rates from a turn to the right. Propellers begin at a typical advance ratio.
        usual_speed = self.usual_speed
        turn: Any = usual_begin(self._states())
        propellers = [
            file for file in self.parts.engines if file.has_propeller and not file.governed
        ]

        def begin(imposed: Mapping[str, Any]) -> dict[str, Any]:
            """Return initial values by name, {} if no altitude or no positive speed is imposed."""
            altitude = imposed.get("altitude")
            if altitude is None:
                return {}
            speed = imposed.get("speed")
            if speed is None or np.min(speed) <= 0.0:
                return {}
            density = _density()(*map(np.atleast_2d, (altitude, imposed.get(ISA, 0.0)))).full()
            lift_coefficient = (
                0.5 * (usual_speed / speed) ** 2 * SEA_LEVEL.density / density.squeeze()
            )
            # A typical lift coefficient is 0.25 + 5 alpha, and 0.5 at sea level at `usual_speed`.
            alpha = np.clip(0.2 * (lift_coefficient - 0.25), -0.05, 0.25)
            values = {"speed": speed, "alpha": alpha, "pitch": alpha + imposed.get("gamma", 0.0)}
            for file in propellers:
                rpm = _usual_propeller_speed(file, speed)
                stated = _stated_speed(file)
                if stated:  # within the usual range of a running propeller
                    rpm = np.clip(rpm, 0.45 * stated, 0.99 * stated)
                values[f"rpm{file.number}"] = rpm
            values |= turn(imposed)
            return values | self._start_of_stopped_engines({**imposed, **values})

        return begin


@cache
def _density() -> ca.Function:
    """Return the function (altitude, ft; deviation of the temperature, K) -> density, slug/ft³."""
    altitude, warmer = ca.SX.sym("altitude"), ca.SX.sym("warmer")
    return ca.Function("density", [altitude, warmer], [air_at(altitude, "english", warmer).density])


def _stated_speed(file: EngineFile) -> float:
    """Return the largest speed of a propeller according to the files, rpm, or 0 if unknown."""
    stated = file.thruster.value_of("maxrpm", 0.0)
    if stated or file.kind != "piston_engine":
        return stated
    # 0.85 is assumed. Only the scale of the speed and the start of a search depend on it.
    return 0.85 * file.engine.value_of("maxrpm", 2800.0) / file.gear_ratio


def _usual_propeller_speed(file: EngineFile, speed: Any) -> Any:
    """Return the speed of a propeller, rpm, at the advance ratio `_ADVANCE_RATIO`."""
    return 60.0 * speed / (_ADVANCE_RATIO * file.thruster.value_of("diameter", 0.001, "FT"))
