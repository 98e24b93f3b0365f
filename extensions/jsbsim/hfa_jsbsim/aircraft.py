"""Equations of motion of a JSBSim aircraft, assembled from its parts."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any

import casadi as ca

from hfa_aircraft.rigid.aircraft import (
    STATES,
    acceleration,
    angular_acceleration,
    flow_rates,
    load_factor,
    state_rates,
    turn_rate,
)
from hfa_aircraft.signals import ISA
from hfa_jsbsim.aerodynamics import Aerodynamics, Reactions
from hfa_jsbsim.air import (
    KNOT_IN_FEET,
    OF_MASS,
    Winds,
    mass_properties,
    motion_of,
    state_properties,
)
from hfa_jsbsim.airframe import Body, Loads, Mass, mass_of
from hfa_jsbsim.catalog import access, of_component
from hfa_jsbsim.control_system import add_control_systems
from hfa_jsbsim.engines import OF_ENGINES, STEP, Effect, EngineFile, MountedEngine, spool_error
from hfa_jsbsim.functions import function_value, property_definitions, table_value
from hfa_jsbsim.parts import LOADED, Parts
from hfa_jsbsim.powerplant import add_engine
from hfa_jsbsim.properties import (
    BEFORE_ALL,
    FilterState,
    Note,
    Properties,
    Unknown,
    Writer,
    canonical,
    contains,
    identifier,
    is_zero,
    key_of,
    symbols_of,
)
from hfa_jsbsim.surfaces import (
    PilotInput,
    names_read_by,
    reach_throttles,
    use_surface_positions,
)
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import BadInputError, shortened

#: Parameters with the velocity of a steady wind toward north, east and down, ft/s. The states are
#: relative to it.
WINDS = ("wind_north", "wind_east", "wind_down")
#: Disturbances with the velocity of gusts toward north, east and up, ft/s.
GUSTS = ("gust_north", "gust_east", "updraft")
_COMMANDS = {
    "aileron": "fcs/aileron-cmd-norm",
    "elevator": "fcs/elevator-cmd-norm",
    "rudder": "fcs/rudder-cmd-norm",
}
#: Rate -> command that changes it.
_TURNED_BY = {"roll_rate": "aileron", "pitch_rate": "elevator", "yaw_rate": "rudder"}
#: Name of a command, which programs around JSBSim set.
_NAME_OF_COMMAND = re.compile("(cmd|command)[^/]*$")
#: Times late in a flight, s, without a common period.
_LATE = tuple(1e5 * math.sqrt(prime) for prime in (2, 3, 5, 7, 11))
#: Most rates in a sentence.
_MOST_RATES = 3
#: Levers with constant positions, by default 0. A gear position of 1 means down.
LEVERS = {
    "flap": "fcs/flap-cmd-norm",
    "gear": "gear/gear-cmd-norm",
    "speedbrake": "fcs/speedbrake-cmd-norm",
    "spoiler": "fcs/spoiler-cmd-norm",
    "pitch_trim": "fcs/pitch-trim-cmd-norm",
    "roll_trim": "fcs/roll-trim-cmd-norm",
    "yaw_trim": "fcs/yaw-trim-cmd-norm",
}


class Equations:
    """Equations x' = f(x, u, p, w), y = h(x, u, p, w) of an aircraft as CasADi expressions.

    states, parameters, gusts: name -> symbol.
    inputs: name -> `PilotInput`.
    rates: state -> its time derivative.
    outputs: name -> expression.
    notes: notes for the user.
    replaced_commands: symbols of the commands that surface positions replace as inputs.
    starts: parameter or chosen input -> value in the files.
    properties: all JSBSim properties.
    mass: mass for the given tank contents and point masses.
    """

    def __init__(self, parts: Parts, gusty: bool = False) -> None:
        """Build the equations from the parts of an aircraft.

        gusty: whether the equations include gusts
        """
        self.parts = parts
        self.notes: list[Note] = []
        self._rights = partial(access, engines=parts.thrusters)
        self.properties = Properties(parts.choices.filters, self._rights)
        #: Property that the user made an input -> name of the input.
        self.chosen: dict[str, str] = {}
        self.starts: dict[str, float] = {}
        #: Property that nothing sets -> name of the parameter or input.
        self.constants: dict[str, str] = {}
        self.replaced_commands: list[ca.SX] = []
        self._replacements: list[tuple[ca.SX, ca.SX]] = []
        self._functions: dict[str, Element] = {}
        self._declare_symbols()

        # Properties of JSBSim itself, then those of the files.
        x = SimpleNamespace(**self.states)
        self.motion = motion_of(x, self._winds(gusty), self.parameters[ISA])
        self._define_motion(x)
        self._define_commands()
        for axis, name in zip(("north", "east", "down"), WINDS, strict=True):
            self.properties.define(f"atmosphere/wind-{axis}-fps", self.parameters[name])
        self._define_masses()
        self._define_functions()
        commands = (given_input.symbol for given_input in self.inputs.values())
        self.properties.commands = ca.vertcat(*commands)
        add_control_systems(parts.systems(), self.properties)
        section = parts.section("aerodynamics")
        aerodynamics = Aerodynamics(section, self.properties, parts.wings, self.motion, self)
        reactions = Reactions(parts.section("external_reactions"), self.properties)
        self._mount_engines(x)
        if section is not None:
            self._use_surface_positions(section)

        # Time derivatives and outputs, and what the files leave open in them.
        self.effects = self._effects()
        self.rates: dict[str, Any] = {}
        self.outputs: dict[str, Any] = {}
        external = reactions.loads(self.motion, self.mass.arm)
        self._set_rates_and_outputs(x, aerodynamics.loads(), external)
        self._add_filters()
        self._solve_rates_of_angles()
        self.set_in_files = dict(self._set_in_files())
        self._refuse_unknowns()
        self._name_constants()
        if (
            aerodynamics.hysteresis is not None
            and "aero/stall-hyst-norm" in self.properties.names_read
        ):
            self.notes.append(aerodynamics.hysteresis)
        self.notes += self.properties.notes

    def _mount_engines(self, x: SimpleNamespace) -> None:
        """Define the properties of the engines and of their total force and moment.

        Throttle positions become the inputs, with a note, where throttle commands have no effect.
        """
        self._mounted = [
            MountedEngine(
                **vars(file),
                properties=self.properties,
                motion=self.motion,
                body=self,
                states=x,
                tanks=self.parts.tanks,
                parameters=self.parameters,
            )
            for file in self.parts.engines
        ]
        self._engines = list(map(add_engine, self._mounted))
        if self._engines:
            self._define_totals()
        throttles = {
            file.number: self.inputs[self._throttle_of(file)].symbol for file in self.parts.engines
        }
        self.notes += reach_throttles(self.properties, throttles)

    @property
    def _values(self) -> ca.SX:
        """Rates and outputs."""
        return ca.vertcat(*self.rates.values(), *self.outputs.values())

    def used_symbols(self) -> set[int]:
        """Return the keys of the symbols on which rates or outputs depend."""
        return symbols_of(self._values)

    def used_inputs(self) -> dict[str, PilotInput]:
        """Return the inputs on which rates or outputs depend, by name."""
        used = self.used_symbols()
        return {
            name: pilot_input
            for name, pilot_input in self.inputs.items()
            if key_of(pilot_input.symbol) in used
        }

    def _declare_symbols(self) -> None:
        """Declare a symbol for each state, input, parameter and gust, and for the time."""
        names = [*STATES, *_engine_states(self.parts)]
        self.states = {name: ca.SX.sym(name) for name in names}
        self.inputs = {name: PilotInput(ca.SX.sym(name)) for name in _COMMANDS}
        for name in self._throttles():
            self.inputs[name] = PilotInput(ca.SX.sym(name), limits=(0.0, 1.0))
        for full_name in self.parts.choices.inputs:
            name = identifier(full_name, "input", self.inputs)
            self.chosen[full_name] = name
            self.inputs[name] = PilotInput(ca.SX.sym(name), limits=(-math.inf, math.inf))
        self.parameters = {name: ca.SX.sym(name) for name in self._parameter_names()}
        self.gusts = {name: ca.SX.sym(name) for name in GUSTS}
        # Forces may depend on the rates of alpha and beta: `_solve_rates_of_angles` replaces these.
        self.rate_symbols = [ca.SX.sym("alpha_rate"), ca.SX.sym("beta_rate")]

    def _define_motion(self, x: SimpleNamespace) -> None:
        """Define the properties of time, state, angular velocity and rates of alpha and beta."""
        properties = self.properties
        fault = "the rates depend on simulation/sim-time-sec, which is not supported"
        self.fault_of_time = ""  # if a force depends on the time
        self._time = properties.unknown(BadInputError(f"{self.parts.path}: {fault}"))
        properties.define("simulation/sim-time-sec", self._time)
        for name, value in state_properties(x, self.motion, self.parts.wings).items():
            properties.define(name, value)
        inertial = ca.vertsplit(self.motion.rates)
        for letter, rate in zip("pqr", inertial, strict=True):
            properties.define(f"velocities/{letter}i-rad_sec", rate)
        for name, symbol in zip(("alpha", "beta"), self.rate_symbols, strict=True):
            properties.define(f"aero/{name}dot-rad_sec", symbol)
            properties.define(f"aero/{name}dot-deg_sec", symbol * (180.0 / math.pi))

    def _use_surface_positions(self, section: Element) -> None:
        """Replace commands by the surface positions that the aerodynamics read in their place."""
        given = dict(self.inputs)
        self.notes += use_surface_positions(names_read_by(section), self.properties, self.inputs)
        self.replaced_commands = [
            command.symbol for name, command in given.items() if self.inputs[name] is not command
        ]

    def _throttles(self) -> list[str]:
        """Return the names of the throttle inputs: one for each engine, or one for all engines."""
        if self.parts.choices.throttles and self.parts.engines:
            return [f"throttle{file.number}" for file in self.parts.engines]
        return ["throttle"]

    def _throttle_of(self, file: EngineFile) -> str:
        """Return the name of the input that is the throttle of an engine."""
        own_name = f"throttle{file.number}"
        return own_name if own_name in self.inputs else "throttle"

    def _parameter_names(self) -> Iterator[str]:
        """Yield the names of the parameters of the model."""
        yield from (*LEVERS, "mixture", "advance", "gravity", ISA, *WINDS)
        yield from (f"tank{number}" for number in range(len(self.parts.tanks)))
        yield from (f"pointmass{number}" for number in range(len(self.parts.points)))
        for file in self.parts.engines:
            yield f"engine{file.number}"
            yield f"feather{file.number}"

    @cached_property
    def mass(self) -> Mass:
        """Weight, center of gravity and inertia, for the given tank contents and point masses."""
        read = partial(self.properties.read_or, where=str(self.parts.path))
        bodies = []
        for number, point in enumerate(self.parts.points):
            parameter = self.parameters[f"pointmass{number}"]
            weight = read(f"inertia/pointmass-weight-lbs[{number}]", parameter)
            names = [f"inertia/pointmass-location-{axis}-inches[{number}]" for axis in "XYZ"]
            place = [read(name, own) for name, own in zip(names, point.location, strict=True)]
            bodies.append(Body(weight, place, point.inertia_at(weight)))
        for number, tank in enumerate(self.parts.tanks):
            parameter = self.parameters[f"tank{number}"]
            contents = read(f"propulsion/tank[{number}]/contents-lbs", parameter)
            bodies.append(tank.body(ca.fmin(contents, tank.capacity)))
        return mass_of(self.parts.empty, bodies)

    def reference_point(self, where: str) -> ca.SX:
        """Return the point where the aerodynamic forces act, structural frame, inches, (3,).

        where: location in a file, for messages
        """
        point = []
        for axis, own in zip("xyz", self.parts.wings.reference_point, strict=True):
            point.append(self.properties.read_or(f"metrics/aero-rp-{axis}-in", own, where))
        return ca.vertcat(*map(ca.SX, point))

    def _winds(self, gusty: bool) -> Winds:
        """Return the steady wind, and the gusts if `gusty`, as symbols."""
        gusts = None
        if gusty:
            north, east, up = (self.gusts[name] for name in GUSTS)
            gusts = ca.vertcat(north, east, -up)
        return Winds(ca.vertcat(*(self.parameters[name] for name in WINDS)), gusts)

    def _define_commands(self) -> None:
        """Define the properties of commands, levers and chosen inputs, and of what is constant."""
        properties = self.properties
        for name, full_name in _COMMANDS.items():
            properties.define(full_name, self.inputs[name].symbol)
        for name, full_name in LEVERS.items():
            properties.define(full_name, self.parameters[name])
        pressure_ratio = properties.read("atmosphere/delta", "")
        for file in self.parts.engines:
            levers = {
                "throttle": self.inputs[self._throttle_of(file)].symbol,
                "mixture": self.parameters["mixture"] * pressure_ratio,  # leaner in thin air
                "advance": self.parameters["advance"],
                "feather": self.parameters[f"feather{file.number}"],
            }
            for lever, value in levers.items():
                command = f"fcs/{lever}-cmd-norm[{file.number}]"
                properties.define(command, value)
                position = f"fcs/{lever}-pos-norm[{file.number}]"
                self._define_lazily(position, partial(properties.read, command, ""))
        for full_name, name in self.chosen.items():
            properties.define(full_name, self.inputs[name].symbol)
        # Constant in flight: the position of a gear that the files do not move, down, and the loads
        # of wheels.
        properties.define_initial("gear/gear-pos-norm", 1.0)
        properties.define("accelerations/gravity-ft_sec2", self.parameters["gravity"])
        properties.define_initial("simulation/dt", STEP)
        for name in ("gear/wow", "propulsion/refuel"):
            properties.define_initial(name, 0.0)
        for along, turn in zip("xyz", "lmn", strict=True):
            properties.define_initial(f"forces/fb{along}-gear-lbs", 0.0)
            properties.define_initial(f"moments/{turn}-gear-lbsft", 0.0)

    def _define_masses(self) -> None:
        """Define the properties of tanks, point masses, mass and center of gravity."""
        self._define_tanks()
        for number, point in enumerate(self.parts.points):
            weight = self.parameters[f"pointmass{number}"]
            self.properties.define(f"inertia/pointmass-weight-lbs[{number}]", weight)
            for axis, place in zip("XYZ", point.location, strict=True):
                full_name = f"inertia/pointmass-location-{axis}-inches[{number}]"
                self.properties.define_initial(full_name, place)
        self.properties.define("inertia/empty-weight-lbs", self.parts.empty.weight)
        for name in OF_MASS:  # computed from `mass`, once its own properties are defined
            self._define_lazily(name, partial(lambda name: mass_properties(self.mass)[name], name))
        self._define_lazily("aero/h_b-mac-ft", self._reference_height)

    def _define_tanks(self) -> None:
        """Define the properties of the tanks and of their total contents."""
        for number, tank in enumerate(self.parts.tanks):
            prefix = f"propulsion/tank[{number}]"
            contents = self.parameters[f"tank{number}"]
            self.properties.define(f"{prefix}/contents-lbs", contents)
            self.properties.define(f"{prefix}/pct-full", 100.0 * contents / tank.capacity)
            self.properties.define_initial(f"{prefix}/density-lbs_per_gal", tank.density)
            self.properties.define_initial(f"{prefix}/priority", tank.priority)
        fuel = (
            self.parameters[f"tank{number}"]
            for number, tank in enumerate(self.parts.tanks)
            if tank.kind == "FUEL"
        )
        self.properties.define("propulsion/total-fuel-lbs", sum(fuel, start=ca.SX(0.0)))

    def _define_lazily(self, name: str, compute: Callable[[], Any]) -> None:
        """Define a property by a function that is called when the property is first read."""
        self.properties.add_writer(name, Writer(compute, "", BEFORE_ALL))

    def _reference_height(self) -> Any:
        """Return the height of the aerodynamic reference point above sea level, per span."""
        arm = self.mass.arm(self.reference_point(""))
        height = self.states["altitude"] - ca.dot(self.motion.down, arm)
        return height / self.parts.wings.span

    def _define_totals(self) -> None:
        """Define the properties of the total force and moment of the engines."""
        for axis, (along, turn) in enumerate(zip("xyz", "lmn", strict=True)):
            for kind, name in (
                ("force", f"forces/fb{along}-prop-lbs"),
                ("moment", f"moments/{turn}-prop-lbsft"),
            ):
                # The defaults keep the values of this turn of the loop until the property is read.
                def total(kind: str = kind, axis: int = axis) -> Any:
                    """Return the sum of one component over all engines."""
                    each = (getattr(effect, kind)[axis] for effect in self._effects())
                    return sum(each, start=ca.SX(0.0))

                self._define_lazily(name, total)

    def _define_functions(self) -> None:
        """Define the properties set by <property value="..."> and by named functions."""
        loaded = sorted(self.parts.sections, key=lambda part: LOADED.index(part.name))
        sections: list[tuple[Element, int | None]] = [(part, None) for part in loaded]
        sections += [(file.engine, file.number) for file in self.parts.engines]
        for section, number in sections:
            # Elements of the aircraft's own file follow those of a file that its section includes.
            for element in section.all("property"):
                is_in_aircraft_file = element.file != section.file
                self._define_property(element, overrides=is_in_aircraft_file)
            for part in property_definitions(section):
                # Such as "MilThrust": defined for each engine by its own section, below.
                of_engine = part.attributes["name"] in OF_ENGINES
                if not (of_engine and section.name == "propulsion"):
                    self._define_function(part, number)

    def _define_property(self, element: Element, overrides: bool) -> None:
        """Set the property of a <property> element."""
        # - JSBSim ignores the value of a read-only property.
        # - A writable built-in property is set if the element has a value, with two exceptions.
        #   Pilot commands keep their symbols. A parameter keeps its symbol, and the value becomes
        #   its value at the start, except for the levers mixture and advance.
        # - Another property is set if it has no value yet, or if the element overrides it. One with
        #   the name of a command becomes a constant, which may be an input.
        value = element.as_number(element.attributes.get("value", "0"))
        full_name = canonical(element.text)
        rights = self._rights(full_name)
        if full_name in self.chosen:
            self.starts.setdefault(self.chosen[full_name], value)
        elif _NAME_OF_COMMAND.search(full_name) and not (
            rights or self.properties.is_known(full_name)
        ):
            self.properties.define_constant(full_name, value, element.where)
            return
        if rights not in ("", "R") and "value" in element.attributes:
            own = self.properties.writer(element.text)  # of JSBSim itself, such as a lever's symbol
            symbol = own.compute() if own is not None and not own.is_of_file else None
            parameter = next((name for name, p in self.parameters.items() if p is symbol), "")
            is_command = any(pilot_input.symbol is symbol for pilot_input in self.inputs.values())
            # Mixture and advance stay 1, with which engines run best.
            if parameter and parameter not in ("mixture", "advance"):
                self.starts[parameter] = value
            if not (parameter or is_command):
                # Order 0: after JSBSim's own values, before all components.
                writer = Writer(lambda: value, element.where, order=0, is_of_file=True)
                self.properties.add_writer(element.text, writer)
        elif not rights and (overrides or not self.properties.is_known(element.text)):
            self.properties.define_initial(element.text, value)

    def _define_function(self, element: Element, number: int | None) -> None:
        """Define the property named by a function or table, computed at the first read."""
        if "copyto" in element.attributes:
            raise element.error("the attribute copyto is not supported; use the function's name")
        name = "-".join(element.attributes["name"].split(" "))
        if number is not None and name in OF_ENGINES:
            name = f"propulsion/engine[#]/{name}"
        value_of = function_value if element.name == "function" else table_value
        compute = partial(value_of, element, self.properties, number)
        if "#" not in name or number is not None:
            full_name = name.replace("#", str(number))
            first = self._functions.setdefault(full_name, element)
            if first is not element:
                fault = f"{shortened(full_name)} is the name of another function ({first.where})"
                raise element.error(f"{fault}; give this function another name")
            writer = Writer(compute, element.where, is_of_file=True)
            self.properties.add_writer(full_name, writer)

    def _effects(self) -> list[Effect]:
        """Return the force, moment and power of each engine."""
        return [
            self.properties.value_of(writer, file.full_name("thrust"), file.mount.where)
            for file, writer in zip(self.parts.engines, self._engines, strict=True)
        ]

    def _set_rates_and_outputs(self, x: Any, air: Loads, external: Loads) -> None:
        """Set the outputs and the time derivatives of all states except filter states."""
        motion = self.motion
        mass = self.mass
        force = sum((effect.force for effect in self.effects), start=air.force + external.force)
        moment = sum((effect.moment for effect in self.effects), start=air.moment + external.moment)
        specific_force = force / mass.slugs
        gravity = self.parameters["gravity"] * motion.down
        velocity_rate = acceleration(motion.velocity, motion.rates, specific_force, gravity)
        rotation_rate = angular_acceleration(motion.rates, moment, mass.inertia)
        self.rates = state_rates(x, motion.velocity, velocity_rate, rotation_rate, motion.climb)
        for effect in self.effects:
            self.rates |= effect.rates

        # As in JSBSim, alpha and beta change with the velocity over the ground, in body axes.
        wind = motion.over_ground - motion.velocity
        over_ground_rate = velocity_rate - ca.cross(motion.rates, wind)
        self._angle_rates = flow_rates(motion.air_velocity, over_ground_rate)[1:]  # [0]: of speed

        weight = mass.slugs * self.parameters["gravity"]
        # Lift, drag and moment in the outputs are those of steady alpha and beta.
        angle_rates = ca.vertcat(*self.rate_symbols)
        loads = ca.vertcat(ca.mtimes(motion.wind_to_body.T, air.force), air.moment)
        steady = ca.substitute(loads, angle_rates, ca.SX.zeros(2))
        self.outputs = {
            "kcas": motion.calibrated / KNOT_IN_FEET,
            "mach": motion.mach,
            "gamma": self.properties.read("flight-path/gamma-rad", ""),
            "turn_rate": turn_rate(x),
            "load_factor": load_factor(motion.alpha, specific_force, self.parameters["gravity"]),
            "lift_to_weight": -loads[2] / weight,  # at the present rates of alpha and beta
            "thrust": sum((effect.thrust for effect in self.effects), start=ca.SX(0.0)),
            "weight": mass.weight,
            "angle_of_attack": ca.SX(motion.alpha),
            "lift": -steady[2],
            "drag": -steady[0],
            "pitching_moment": steady[4],
            "dynamic_pressure": ca.SX(motion.pressure_head),
            "reference_area": ca.SX(self.parts.wings.area),
            "reference_chord": ca.SX(self.parts.wings.chord),
            "ground_speed": self.properties.read("velocities/vg-fps", ""),
            "track": self.properties.read("flight-path/psi-gt-rad", ""),
        }
        for file, effect in zip(self._mounted, self.effects, strict=True):
            if effect.power is not None:
                self.outputs[f"power{file.number}"] = effect.power
            if file.lag.startswith("spool") and file.lag in self.states:
                self.outputs[f"spool_error{file.number}"] = spool_error(file)

    def _add_filters(self) -> None:
        """Add the states of the control system that move a force, or with ?filters=states all, with
        their time derivatives.
        """
        properties = self.properties
        pending = properties.filters
        while reached := self._reached(pending):
            for state in reached:
                if state.writer is None:
                    raise state.component.error(
                        f"the output of <{state.component.name}> cannot be computed; remove this "
                        "component"
                    )
                name = state.symbol.name()
                self.states[name] = state.symbol
                self.rates[name] = ca.SX(properties.value_of(state.writer, name, ""))
                if not properties.has_filter_states:
                    properties.take_up(state.component)
            # Computing a derivative may append further states, and reaches others.
            pending = [each for each in properties.filters if each.symbol.name() not in self.states]
        self._idle = [integral.symbol for integral in pending]
        properties.filters = [each for each in properties.filters if each not in pending]

    def _reached(self, states: list[FilterState]) -> list[FilterState]:
        """Return the states of the control system that are states of the aircraft: with the
        properties as the files set them, they move, and move a force.
        """
        properties = self.properties
        if properties.has_filter_states or not states:
            return states
        moving = symbols_of(properties.in_files(ca.vertcat(*self.rates.values())))
        return [
            state
            for state in states
            if state.writer is None
            or (
                key_of(state.symbol) in moving
                and not is_zero(properties.in_files(properties.value_of(state.writer, "", "")))
            )
        ]

    def _solve_rates_of_angles(self) -> None:
        """Solve for the time derivatives of alpha and beta, on which forces may depend."""
        # Newton's method. One step is exact for linear equations, and three suffice for quadratic
        # ones. The 2 x 2 system is solved by Cramer's rule.
        symbols = ca.vertcat(*self.rate_symbols)
        wanted = ca.vertcat(*self._angle_rates)  # functions of the symbols
        if not ca.depends_on(self._values, symbols):
            return
        slopes = ca.jacobian(wanted, symbols) - ca.SX.eye(2)
        angle_rates = ca.SX.zeros(2)
        for _ in range(3 if ca.depends_on(slopes, symbols) else 1):
            miss, slope = ca.substitute([wanted - symbols, slopes], [symbols], [angle_rates])
            determinant = slope[0, 0] * slope[1, 1] - slope[0, 1] * slope[1, 0]
            step = ca.vertcat(
                slope[1, 1] * miss[0] - slope[0, 1] * miss[1],
                slope[0, 0] * miss[1] - slope[1, 0] * miss[0],
            )
            angle_rates = angle_rates - step / determinant
        self._substitute(dict(zip(self.rate_symbols, ca.vertsplit(angle_rates), strict=True)))

    def _name_constants(self) -> None:
        """Turn each constant, a property that nothing in the files sets, into a parameter, or into
        an input if it turns the aircraft about an axis that no command of the pilot turns.
        """
        constants, used = self.properties.constants, self.used_inputs()
        axes = [axis for axis, command in _TURNED_BY.items() if command not in used]
        turning = ca.vertcat(*(self.rates[axis] for axis in axes))  # that no command changes
        for full_name, constant in constants.items():
            taken = (*self.states, *self.inputs, *self.parameters, *self.outputs)
            name = identifier(full_name, "constant", taken)
            self.constants[full_name] = name
            self.starts[name] = constant.start
            is_command = False
            if axes and full_name in self.properties.in_control:
                effect = ca.jtimes(turning, constant.symbol, ca.SX(1.0))
                is_command = ca.sparsify(effect).nnz() > 0
            if is_command:
                self.inputs[name] = PilotInput(constant.symbol, limits=(-math.inf, math.inf))
            else:
                self.parameters[name] = constant.symbol

    def _set_in_files(self) -> Iterator[tuple[str, list[Writer]]]:
        """Yield JSBSim's own properties, with the writers of the files that are ever executed."""
        properties = self.properties
        for name, writers in list(properties.writers.items()):
            if not self._rights(name):
                continue
            in_files = []
            for writer in (each for each in writers if each.is_of_file):
                if "/malfunction/" in name and writer.component is None:
                    continue  # JSBSim ignores the value of a <property>
                on = 1.0 if writer.is_on is None else writer.is_on()
                if of_component(name) or name == "propulsion/cutoff_cmd":  # 0: no failure
                    on = on * properties.value_of(writer, name, writer.where)
                if not is_zero(properties.in_files(on)):
                    in_files.append(writer)
                    continue
                inside = symbols_of(on)
                properties.frozen |= {
                    full_name
                    for full_name, constant in properties.constants.items()
                    if key_of(constant.symbol) in inside
                }
            if in_files:
                yield name, in_files

    def _refuse_unknowns(self) -> None:
        """Raise BadInputError if a force depends on what is unknown, with the properties as they
        stand in the files; otherwise remove it.
        """
        properties = self.properties
        presents = [*properties.presents()]
        used = self.used_symbols() if presents else set()
        for symbol, present, writer in presents:
            if present.is_constant() and key_of(symbol) in used:
                kept = f"{shortened(writer.name)} ({float(present):g})"
                self.notes.append(Note("these keep their first value", kept, writer.where))
        for _ in range(2):  # values of the past may contain each other
            self._substitute({symbol: present for symbol, present, _ in presents})
        self._substitute(dict.fromkeys(self._idle, 0.0))
        self._freeze()
        faults = []
        used = self.used_symbols()
        for unknown in properties.unknowns:
            if key_of(unknown.symbol) not in used:
                continue
            if unknown.symbol is self._time:
                self.fault_of_time = self._fault(unknown)
                self._replacements.append((self._time, ca.SX(0.0)))
                self._set_values(self._late_values())
                statement = "no trim is where a force differs between {} times late in a flight"
                self.notes.append(Note(statement.format(len(_LATE))))
            elif properties.hide(self._values, unknown):
                self._freeze()
                used = self.used_symbols()
            else:
                faults.append(self._fault(unknown))
        if faults:
            raise BadInputError("; ".join(dict.fromkeys(faults)))

    def _late_values(self) -> list[ca.SX]:
        """Return time derivatives and outputs late in a flight, nan at the states at which they
        differ between the times `_LATE`.
        """
        others = [each for each in ca.symvar(self._values) if not ca.is_equal(each, self._time)]
        # `parts` replaces the operations that do not depend on the time.
        values, symbols, parts = ca.extract_parametric(self._values, ca.vertcat(*others))
        first, *later = (ca.substitute(values, self._time, time) for time in _LATE)
        differs = sum(value != first for value in later)
        late = ca.if_else(differs, math.nan, first)
        return ca.vertsplit(ca.substitute(late, ca.vertcat(*symbols), ca.vertcat(*parts)))

    def _fault(self, unknown: Unknown) -> str:
        """Return the refusal of an unknown, with what it changes and by which path."""
        moved = [name for name, rate in self.rates.items() if contains(rate, unknown.symbol)]
        moved = moved or [*self.outputs]
        rates = ", ".join(moved[:_MOST_RATES]) + ", ..." * (len(moved) > _MOST_RATES)
        path = self.properties.path_of(unknown)
        return f"{unknown.error} (it changes {rates}{path and ' by '}{path})"

    def resolved(self, value: Any) -> ca.SX:
        """Return a value with the replacements of the time derivatives and outputs."""
        value = ca.SX(value)
        for symbol, replacement in self._replacements:
            value = ca.substitute(value, symbol, replacement)
        return value

    def _freeze(self) -> None:
        """Replace the frozen constants by their values in the files."""
        frozen = map(self.properties.constants.__getitem__, self.properties.frozen)
        self._substitute({constant.symbol: constant.start for constant in frozen})

    def _substitute(self, replaced: Mapping[ca.SX, Any]) -> None:
        """Replace symbols by values in all time derivatives and outputs."""
        if not replaced:
            return
        symbols, values = ca.vertcat(*replaced), ca.vertcat(*replaced.values())
        self._replacements.append((symbols, values))
        if not self.used_symbols().isdisjoint(map(key_of, replaced)):
            self._set_values(ca.vertsplit(ca.substitute(self._values, symbols, values)))

    def _set_values(self, values: list[ca.SX]) -> None:
        """Set all time derivatives and outputs."""
        named = dict(zip([*self.rates, *self.outputs], values, strict=True))
        self.rates = {name: named[name] for name in self.rates}
        self.outputs = {name: named[name] for name in self.outputs}


def _engine_states(parts: Parts) -> Iterator[str]:
    """Yield the names of the engine states: propeller speeds, governed blade angles, and lags."""
    for file in parts.engines:
        if file.has_propeller:
            yield f"rpm{file.number}"
            if file.governed:
                yield f"blade{file.number}"
        if file.lag and parts.choices.engines:  # ?engines=states
            yield file.lag
