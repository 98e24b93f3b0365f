"""The parts of an aircraft of JSBSim, and its equations of motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from hfa_jsbsim import engines as jets
from hfa_jsbsim.aerodynamics import Aerodynamics
from hfa_jsbsim.air import KNOT, motion_of, state_properties
from hfa_jsbsim.airframe import read_mass, read_metrics, read_tanks
from hfa_jsbsim.control_system import add_control_systems
from hfa_jsbsim.engines import Effect, EngineFile, Surroundings
from hfa_jsbsim.functions import function_value
from hfa_jsbsim.piston import piston_power
from hfa_jsbsim.propeller import HP, propeller_effect
from hfa_jsbsim.properties import Properties, Writer
from hfa_jsbsim.surfaces import (
    PilotInput,
    cut_surfaces,
    names_read_by,
    reach_throttles,
)
from hfa_jsbsim.xml_file import Element, Folders
from hfa_support.errors import BadInputError, shortened

_SYSTEMS = ("system", "autopilot", "flight_control")
#: The states of a rigid body over a flat earth, in order; those of propellers follow.
STATES = (
    *("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate"),
    *("roll", "pitch", "yaw", "altitude"),
)
_COMMANDS = {
    "aileron": "fcs/aileron-cmd-norm",
    "elevator": "fcs/elevator-cmd-norm",
    "rudder": "fcs/rudder-cmd-norm",
}
#: Levers that stay where they are; all are 0 unless given. gear: 1 is down.
_LEVERS = {
    "flap": "fcs/flap-cmd-norm",
    "gear": "gear/gear-cmd-norm",
    "speedbrake": "fcs/speedbrake-cmd-norm",
    "spoiler": "fcs/spoiler-cmd-norm",
    "pitch_trim": "fcs/pitch-trim-cmd-norm",
    "roll_trim": "fcs/roll-trim-cmd-norm",
    "yaw_trim": "fcs/yaw-trim-cmd-norm",
}


class Parts:
    """What the files of an aircraft hold.

    sections: <metrics>, <aerodynamics>, ... with what other files add.
    wings, mass, tanks, engines: read from them.
    notes: what a user should know.
    partial: leave out motors, rotors and gas, which cannot be read; else they are refused.
    """

    def __init__(self, path: Path, folders: Folders, partial: bool = False) -> None:
        root = folders.read(path)
        if root.name != "fdm_config":
            fault = f"<{shortened(root.name)}> is no aircraft of JSBSim"
            raise root.error(f"{fault}; its files begin with <fdm_config>")
        self.path = path
        self.name = root.attributes.get("name", path.stem)
        self.notes: list[str] = []
        unread = ("fileheader", "planet", "input", "output", "child", "ground_reactions")
        children = [child for child in root.children if child.name not in unread]
        self.sections = [folders.merged(child) for child in children]
        gas = self.section("buoyant_forces")
        if gas is not None and not partial:
            raise gas.error("<buoyant_forces> is not read; the aircraft must fly without gas")
        propulsion = self.section("propulsion")
        self.wings = read_metrics(self._needed("metrics"))
        self.tanks = read_tanks(propulsion)
        self.mass = read_mass(self._needed("mass_balance"), self.tanks)
        self.engines: list[EngineFile] = []
        for number, mount in enumerate(propulsion.all("engine") if propulsion else ()):
            engine = jets.read_engine(number, mount, folders.opened, self.tanks)
            if isinstance(engine, EngineFile):
                self.engines.append(engine)
            elif partial:
                self.notes.append(f"{engine.where}: {jets.refusal(engine)}; it is left out")
            else:
                raise engine.error(jets.refusal(engine))

    def section(self, name: str) -> Element | None:
        """The first section of this name."""
        return next((part for part in self.sections if part.name == name), None)

    def systems(self) -> list[Element]:
        """The sections of the control system, in JSBSim's order."""
        return [part for name in _SYSTEMS for part in self.sections if part.name == name]

    def _needed(self, name: str) -> Element:
        section = self.section(name)
        if section is None:
            raise BadInputError(f"{self.path}: the aircraft has no <{name}>; add it")
        return section


class Equations:
    """x' = f(x, u, p), y = h(x, u, p) of an aircraft as expressions.

    states, parameters: name -> symbol. inputs: name -> `PilotInput`.
    rates: by state. outputs: by name. notes: what a user should know.
    properties: the values of all of JSBSim's properties.
    """

    def __init__(self, parts: Parts) -> None:
        self.parts = parts
        self.notes: list[str] = []
        self.properties = Properties()
        names = [*STATES, *_propeller_states(parts.engines)]
        self.states = {name: ca.SX.sym(name) for name in names}
        self.inputs = {name: PilotInput(ca.SX.sym(name)) for name in _COMMANDS}
        self.inputs["throttle"] = PilotInput(ca.SX.sym("throttle"), limits=(0.0, 1.0))
        parameters = (*_LEVERS, "mixture", "advance", "gravity")
        self.parameters = {name: ca.SX.sym(name) for name in parameters}
        x = SimpleNamespace(**self.states)
        self.motion = motion_of(x)
        values = state_properties(x, self.motion, parts.wings, parts.mass)
        for name, value in values.items():
            self.properties.define(name, value)
        self.rate_symbols = [ca.SX.sym("alpha_rate"), ca.SX.sym("beta_rate")]
        for name, symbol in zip(("alpha", "beta"), self.rate_symbols, strict=True):
            self.properties.define(f"aero/{name}dot-rad_sec", symbol)
            self.properties.define(f"aero/{name}dot-deg_sec", symbol * (180.0 / math.pi))
        self._define_commands()
        self._define_tanks()
        self._define_functions()
        throttle = self.inputs["throttle"].symbol
        commands = ca.vertcat(*(given_input.symbol for given_input in self.inputs.values()))
        add_control_systems(parts.systems(), self.properties, commands)
        section = parts.section("aerodynamics")
        air_loads = Aerodynamics(section, self.properties, parts.wings, parts.mass, self.motion)
        around = Surroundings(self.properties, self.motion, parts.mass, x)
        self._engines = [self._add_engine(file, around) for file in parts.engines]
        numbers = [file.number for file in parts.engines]
        self.notes += reach_throttles(numbers, self.properties, throttle)
        if section is not None:
            names = names_read_by(section)
            self.notes += cut_surfaces(names, self.properties, self.inputs)
        self.effects = self._effects()
        self.notes += self.properties.notes
        self.rates: dict[str, Any] = {}
        self.outputs: dict[str, Any] = {}
        self._move(x, *air_loads.loads())

    def _define_commands(self) -> None:
        """Let the pilot's commands and levers set their properties."""
        properties = self.properties
        for name, full_name in _COMMANDS.items():
            properties.define(full_name, self.inputs[name].symbol)
        for name, full_name in _LEVERS.items():
            properties.define(full_name, self.parameters[name])
        pressure_ratio = properties.read("atmosphere/delta", "")
        levers = {
            "throttle": self.inputs["throttle"].symbol,
            "mixture": self.parameters["mixture"] * pressure_ratio,
            "advance": self.parameters["advance"],
            "feather": 0.0,
        }
        for file in self.parts.engines:
            for lever, value in levers.items():
                command = f"fcs/{lever}-cmd-norm[{file.number}]"
                properties.define(command, value)
                follow = Writer(partial(properties.read, command, file.mount.where), "", -1)
                properties.compute(f"fcs/{lever}-pos-norm[{file.number}]", follow)
        properties.define_initial("gear/gear-pos-norm", 1.0)
        properties.define("accelerations/gravity-ft_sec2", self.parameters["gravity"])
        for name in ("simulation/sim-time-sec", "gear/wow", "propulsion/refuel"):
            properties.define_initial(name, 0.0)
        for axis in "xyz":
            properties.define_initial(f"forces/fb{axis}-buoyancy-lbs", 0.0)
            properties.define_initial(f"forces/fb{axis}-external-lbs", 0.0)

    def _define_tanks(self) -> None:
        """Let the tanks set their properties."""
        for number, tank in enumerate(self.parts.tanks):
            share = 100.0 * tank.contents / tank.capacity if tank.capacity else 0.0
            values = {
                "contents-lbs": tank.contents,
                "density-lbs_per_gal": tank.density,
                "pct-full": share,
                "priority": 1.0,
            }
            for name, value in values.items():
                self.properties.define_initial(f"propulsion/tank[{number}]/{name}", value)
        fuel = sum(tank.contents for tank in self.parts.tanks if tank.kind == "FUEL")
        self.properties.define_initial("propulsion/total-fuel-lbs", fuel)

    def _define_functions(self) -> None:
        """Let <property value="..."> and functions with names set their properties."""
        sections: list[tuple[Element, int | None]] = [(part, None) for part in self.parts.sections]
        sections += [(file.engine, file.number) for file in self.parts.engines]
        for section, number in sections:
            for element in section.all("property"):
                text = element.attributes.get("value", "0")
                self.properties.define_initial(element.text, element.as_number(text))
            for function in _named_functions(section):
                self._define_function(function, number)

    def _define_function(self, element: Element, number: int | None) -> None:
        """Let a function set the property of its name."""
        name = "-".join(element.attributes["name"].split(" "))

        def compute() -> Any:
            return function_value(element, self.properties, number)

        if "#" not in name:
            self.properties.compute(name, Writer(compute, element.where))
        elif number is not None:
            full_name = name.replace("#", str(number))
            self.properties.compute(full_name, Writer(compute, element.where))

    def _add_engine(self, file: EngineFile, around: Surroundings) -> Writer:
        """Let an engine set its properties; the value of what is returned is its effect."""
        writer = jets.add_engine(file, around, _computing(file, around))
        if file.number == 0:
            for axis, (along, moment_axis) in enumerate(zip("xyz", "lmn", strict=True)):
                self._define_sum(f"forces/fb{along}-prop-lbs", "force", axis)
                self._define_sum(f"moments/{moment_axis}-prop-lbsft", "moment", axis)
        return writer

    def _define_sum(self, name: str, kind: str, axis: int) -> None:
        """Let the sum of all engines set a property."""

        def compute() -> Any:
            parts = (getattr(effect, kind)[axis] for effect in self._effects())
            return sum(parts, start=ca.SX(0.0))

        self.properties.compute(name, Writer(compute, "", -1))

    def _effects(self) -> list[Effect]:
        """The effects of all engines."""
        return [
            self.properties.value_of(writer, file.property("thrust"), file.mount.where)
            for file, writer in zip(self.parts.engines, self._engines, strict=True)
        ]

    def _move(self, x: Any, air_force: ca.SX, air_moment: ca.SX) -> None:
        """Rates of all states, and the outputs."""
        motion = self.motion
        mass = self.parts.mass
        force = sum((effect.force for effect in self.effects), start=air_force)
        moment = sum((effect.moment for effect in self.effects), start=air_moment)
        pushed = force / mass.slugs
        gravity = self.parameters["gravity"] * motion.down
        acceleration = pushed + gravity - ca.cross(motion.rates, motion.velocity)
        inertia = ca.DM(mass.inertia)
        spin = ca.cross(motion.rates, ca.mtimes(inertia, motion.rates))
        inverse = ca.DM(np.linalg.inv(mass.inertia))
        rotation = ca.mtimes(inverse, moment - spin)
        u, v, w = ca.vertsplit(motion.velocity)
        in_plane = u**2 + w**2
        speed_rate = ca.dot(motion.velocity, acceleration) / motion.speed
        alpha_rate = (u * acceleration[2] - w * acceleration[0]) / in_plane
        beta_rate = (motion.speed * acceleration[1] - v * speed_rate) / (
            motion.speed * ca.sqrt(in_plane)
        )
        turning = (x.pitch_rate * ca.sin(x.roll) + x.yaw_rate * ca.cos(x.roll)) / ca.cos(x.pitch)
        self.rates = {
            "speed": speed_rate,
            "alpha": alpha_rate,
            "beta": beta_rate,
            "roll_rate": rotation[0],
            "pitch_rate": rotation[1],
            "yaw_rate": rotation[2],
            "roll": x.roll_rate + ca.sin(x.pitch) * turning,
            "pitch": x.pitch_rate * ca.cos(x.roll) - x.yaw_rate * ca.sin(x.roll),
            "yaw": turning,
            "altitude": motion.climb,
        }
        for effect in self.effects:
            self.rates |= effect.rates
        weight = mass.slugs * self.parameters["gravity"]
        wind_force = ca.mtimes(motion.wind_to_body.T, air_force)
        self.outputs = {
            "kcas": motion.calibrated / KNOT,
            "mach": motion.mach,
            "gamma": ca.asin(motion.climb / motion.speed),
            "turn_rate": turning,
            "load_factor": -pushed[2] / self.parameters["gravity"],
            "lift_to_weight": -wind_force[2] / weight,
            "thrust": sum((effect.thrust for effect in self.effects), start=ca.SX(0.0)),
        }
        for file, effect in zip(self.parts.engines, self.effects, strict=True):
            if effect.power is not None:
                self.outputs[f"power{file.number}"] = effect.power
        self._solve_rates_of_angles()

    def _solve_rates_of_angles(self) -> None:
        """Put alphadot and betadot, on which forces of the air depend, into all rates.

        One Newton step solves the linear equations for them; two more those that are quadratic.
        """
        symbols = ca.vertcat(*self.rate_symbols)
        names = [*self.rates, *self.outputs]
        values = ca.vertcat(*self.rates.values(), *self.outputs.values())
        wanted = ca.vertcat(self.rates["alpha"], self.rates["beta"])
        if not ca.depends_on(values, symbols):
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
        solved = dict(
            zip(names, ca.vertsplit(ca.substitute(values, symbols, angle_rates)), strict=True)
        )
        self.rates = {name: solved[name] for name in self.rates}
        self.outputs = {name: solved[name] for name in self.outputs}


def _propeller_states(engines: list[EngineFile]) -> Iterator[str]:
    """rpm of each propeller, blade angle of each governed one."""
    for file in engines:
        if file.has_propeller:
            yield f"rpm{file.number}"
            if file.governed:
                yield f"blade{file.number}"


def _named_functions(section: Element) -> Iterator[Element]:
    """All functions of a section that have a name, those in others too."""
    pending = [section]
    while pending:
        part = pending.pop()
        if part.name == "channel":
            continue
        pending += reversed(part.children)
        if part.name == "function" and part.attributes.get("name"):
            yield part


def _computing(file: EngineFile, around: Surroundings) -> Callable[[], Effect]:
    """What works out the effect of an engine."""

    def compute() -> Effect:
        if file.kind == "turbine_engine":
            power = jets.turbine_thrust(file, around)  # its lb are taken as ft lb/s by a propeller
            if not file.has_propeller:
                return jets.jet(file, around, power)
            return propeller_effect(file, around, power)
        if file.kind == "rocket_engine":
            return jets.jet(file, around, jets.rocket_thrust(file, around))
        properties: dict[str, Any] = {}
        if file.kind == "piston_engine":
            horsepower, properties = piston_power(file, around)
        elif file.kind == "turboprop_engine":
            horsepower = jets.turboprop_power(file, around)
        else:
            horsepower = jets.electric_power(file, around)
        if not file.has_propeller:
            return jets.jet(file, around, horsepower * HP)
        effect = propeller_effect(file, around, horsepower * HP)
        effect.properties |= properties
        return effect

    return compute
