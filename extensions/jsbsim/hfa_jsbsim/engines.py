"""Engines and thrusters (`FGEngine`, `FGThruster`).

The kinds are turbines, rockets, turboprops and electric engines. `piston.py` adds piston engines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.aircraft import rotation
from hfa_jsbsim.air import Motion
from hfa_jsbsim.airframe import Tank
from hfa_jsbsim.functions import function_value, read_table, table_value
from hfa_jsbsim.properties import MOTION, Note, Properties
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened

#: Fraction of the power beyond the torque limit that passes the limiter, so that a trim search has
#: a descent direction. The power in JSBSim oscillates by as much.
_SHARE_BEYOND_LIMIT = 1e-3
#: Duration of JSBSim's frame, s. Spools and governors near their target reach it within one frame.
STEP = 1.0 / 120.0
#: Kind of engine -> state of its lag: shaft speed of a turbine, %; manifold pressure, inHg; gas
#: generator speed of a turboprop, %.
_LAGS = {"turbine_engine": "spool", "piston_engine": "manifold", "turboprop_engine": "generator"}
#: Least gear ratio that JSBSim accepts.
_SLOWEST_GEAR = 0.001
#: Horsepower, ft lb/s.
HP = 550.0
#: Functions in engine files that JSBSim names propulsion/engine[NUMBER]/NAME.
OF_ENGINES = (
    *("IdleThrust", "MilThrust", "AugThrust", "Injection", "EnginePowerVC"),
    *("N1SpoolUp", "N1SpoolDown", "N2SpoolUp", "N2SpoolDown"),
)
KINDS = ("turbine_engine", "rocket_engine", "piston_engine", "turboprop_engine", "electric_engine")
THRUSTERS = ("propeller", "direct", "nozzle")


@dataclass(frozen=True)
class EngineFile:
    """Engine with its thruster, as described in the files.

    number: index of the engine, from 0.
    mount: <engine> element of the aircraft.
    engine: element of the engine, such as turbine_engine.
    thruster_mount: <thruster> element of the aircraft.
    thruster: element of the thruster: propeller, direct or nozzle.
    location: location of the thruster, structural frame, inches.
    feeds: indices of the tanks that feed the engine.
    dry_of: "fuel" or "oxidizer" if the feeding tanks contain none in the file, else "".
    """

    number: int
    mount: Element
    engine: Element
    thruster_mount: Element
    thruster: Element
    location: np.ndarray
    feeds: tuple[int, ...]
    dry_of: str

    @property
    def kind(self) -> str:
        """Kind of the engine, such as "turbine_engine"."""
        return self.engine.name

    @property
    def has_propeller(self) -> bool:
        """True if the thruster is a propeller."""
        return self.thruster.name == "propeller"

    @property
    def governed(self) -> bool:
        """True if a governor changes the blade angle of the propeller.

        <constspeed> has no effect on fixed blades.
        """
        if not self.has_propeller:
            return False
        lowest = self.thruster.value_of("minpitch", 0.0)
        highest = self.thruster.value_of("maxpitch", 0.0)
        default = 0.0 if self.thruster.find("maxrpm") is None else 1.0  # as in JSBSim
        wants_governor = self.thruster.value_of("constspeed", default) != 0.0
        return wants_governor and lowest != highest

    @property
    def gear_ratio(self) -> float:
        """Revolutions of the engine per revolution of the propeller.

        Raises BadInputError if the ratio is below `_SLOWEST_GEAR`.
        """
        ratio = self.thruster.value_of("gearratio", 1.0)
        if ratio < _SLOWEST_GEAR:
            fault = f"<gearratio> is {ratio:g}; give at least {_SLOWEST_GEAR}"
            raise self.thruster.need("gearratio").error(fault)
        return ratio

    @property
    def lag(self) -> str:
        """Name of the state of the engine's lag, or "" if the engine has no lag."""
        delay = 1.0  # of a turbine, which always has a lag
        if self.kind == "piston_engine":
            delay = self.engine.value_of("man-press-lag", 1.0)
        if self.kind == "turboprop_engine":
            delay = self.engine.value_of("n1idle_max_delay", 1.0)
        if self.kind not in _LAGS or delay <= STEP:  # at once in JSBSim
            return ""
        return f"{_LAGS[self.kind]}{self.number}"

    def shaft(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest speed of a shaft according to the engine's file, %.

        name: "n1" or "n2"
        """
        idle = 30.0 if name == "n1" else 60.0
        return self.engine.value_of(f"idle{name}", idle), self.engine.value_of(f"max{name}", 100.0)

    @property
    def usual_lag(self) -> float:
        """Typical value of the state of the engine's lag."""
        if self.kind == "piston_engine":
            return 24.0  # inHg
        low, high = self.shaft("n2" if self.kind == "turbine_engine" else "n1")
        return low + 0.6 * (high - low)

    def full_name(self, name: str) -> str:
        """Return the full name of a property of this engine, such as propulsion/engine[0]/n1.

        name: last part of the name
        """
        return f"propulsion/engine[{self.number}]/{name}"


@dataclass
class Effect:
    """Force, moment and power of an engine at given states and inputs.

    force: body axes, lb, (3,).
    moment: about the center of gravity, body axes, ft lb, (3,).
    thrust: thrust along the axis of the thruster, lb.
    power: power at the propeller, hp, or None for a jet.
    rates: engine state -> its time derivative.
    properties: last part of the name -> value, for further properties that the engine sets.
    """

    force: Any
    moment: Any
    thrust: Any
    power: Any = None
    rates: dict[str, Any] = field(default_factory=dict)
    properties: dict[str, Any] = field(default_factory=dict)


def read_engine(number: int, mount: Element, opened: Any, tanks: Sequence[Tank]) -> EngineFile:
    """Return the engine that an <engine> element describes.

    number: index of the engine
    mount: the <engine> element
    opened: function that returns the root of the file that an element names
    tanks: tanks of the aircraft

    Raises BadInputError if the engine or its thruster is not supported.
    """
    thruster_mount = mount.need("thruster")
    engine = _content(mount, opened, KINDS)
    thruster = _content(thruster_mount, opened, THRUSTERS)
    point = thruster_mount.find("location")
    location = np.zeros(3) if point is None else point.vector("IN")
    numbers = [int(feed.number()) for feed in mount.all("feed")]
    feeds = tuple(index for index in numbers if 0 <= index < len(tanks))  # tanks that exist
    dry = _dry_of(engine, [tanks[index] for index in feeds])
    return EngineFile(number, mount, engine, thruster_mount, thruster, location, feeds, dry)


def _content(mount: Element, opened: Any, kinds: Sequence[str]) -> Element:
    """Return the engine or thruster that a mount contains, or that the mount's file contains."""
    part: Element = opened(mount)
    if part is mount:  # it names no file
        inside = (
            child
            for child in mount.children
            if child.name in kinds or child.name.endswith("_engine")  # also an unsupported one
        )
        part = next(inside, mount)
    if part.name not in kinds:
        raise part.error(
            f"<{shortened(part.name)}> is not supported; use {', '.join(KINDS)} with "
            "propeller, direct or nozzle"
        )
    return part


def _dry_of(engine: Element, feeds: Sequence[Tank]) -> str:
    """Return "fuel" or "oxidizer" if the tanks that feed an engine contain none, else ""."""
    if engine.name == "electric_engine":
        return ""
    oxidizers = [tank.usable for tank in feeds if tank.kind == "OXIDIZER"]
    if engine.name == "rocket_engine" and oxidizers and not any(oxidizers):
        return "oxidizer"
    has_fuel = any(tank.usable for tank in feeds if tank.kind == "FUEL")
    return "" if has_fuel else "fuel"


@dataclass(frozen=True)
class MountedEngine(EngineFile):
    """Engine in its aircraft, with the quantities on which it depends.

    properties: all JSBSim properties.
    motion: motion relative to the air.
    body: object with `mass`.
    states: object with the states as attributes.
    tanks: all tanks, of which an engine uses those in `feeds`.
    parameters: name -> symbol.
    """

    properties: Properties
    motion: Motion
    body: Any
    states: Any
    tanks: Sequence[Tank]
    parameters: Mapping[str, ca.SX]

    def read(self, name: str) -> ca.SX:
        """Return the value of a property."""
        return ca.SX(self.properties.read(name, self.mount.where))

    def own(self, name: str, default: float) -> Any:
        """Return a property of the engine that a system may set, or the value in its file."""
        return self.properties.read_or(self.full_name(name), default, self.mount.where)

    @property
    def throttle(self) -> ca.SX:
        """Position of the throttle."""
        return self.read(f"fcs/throttle-pos-norm[{self.number}]")

    @property
    def propeller_rpm(self) -> Any:
        """Speed of the propeller, rpm."""
        return getattr(self.states, f"rpm{self.number}")

    @property
    def rpm(self) -> Any:
        """Speed of the engine's shaft, rpm: propeller speed times gear ratio."""
        return self.propeller_rpm * self.gear_ratio

    @property
    def lag_state(self) -> ca.SX | None:
        """Symbol of the state of the engine's lag, or None if the lag is not a state."""
        return getattr(self.states, self.lag, None) if self.lag else None


def running(mounted: MountedEngine) -> ca.SX:
    """Return an expression that is 1 if the engine runs and 0 if it does not.

    An engine runs if its parameter is positive and tanks feed it (`FGPropulsion::ConsumeFuel`). An
    electric engine needs no tank.
    """
    on = mounted.parameters[f"engine{mounted.number}"] > 0.0
    if mounted.kind == "electric_engine":
        return on
    fed = _fed(mounted, "FUEL")
    oxidizers = [number for number in mounted.feeds if mounted.tanks[number].kind == "OXIDIZER"]
    if mounted.kind == "rocket_engine" and oxidizers:
        fed = ca.logic_and(fed, _fed(mounted, "OXIDIZER"))
    return ca.logic_and(on, fed)


def _fed(mounted: MountedEngine, kind: str) -> ca.SX:
    """Return whether an open tank that feeds the engine contains usable fuel or oxidizer."""
    fed = ca.SX(0.0)
    for number in mounted.feeds:
        tank = mounted.tanks[number]
        if tank.kind != kind:
            continue
        prefix = f"propulsion/tank[{number}]"
        parameter = mounted.parameters[f"tank{number}"]
        read = partial(mounted.properties.read_or, where=mounted.mount.where)
        priority = ca.SX(read(f"{prefix}/priority", float(tank.priority)))
        contents = ca.SX(read(f"{prefix}/contents-lbs", parameter))
        is_open = ca.logic_and(priority >= 1.0, priority <= len(mounted.tanks))
        fed = ca.logic_or(fed, ca.logic_and(is_open, contents > tank.unusable))
    return fed


def orientation(mounted: MountedEngine) -> ca.SX:
    """Return the rotation matrix (3, 3) from the thruster's axes to body axes."""
    turned = mounted.thruster_mount.find("orient")
    angles = [0.0, 0.0, 0.0] if turned is None else list(turned.vector("RAD"))
    for axis, name in ((1, "pitch"), (2, "yaw")):  # a system may vector the thrust
        angles[axis] = mounted.own(f"{name}-angle-rad", angles[axis])
    return ca.SX(rotation(*angles))


def thruster_location(mounted: MountedEngine) -> ca.SX:
    """Return the location of the thruster, structural frame, inches, (3,)."""
    return ca.SX(ca.DM(mounted.location))


def thrust_force_and_moment(
    mounted: MountedEngine, thrust: Any, location: Any = None, moment: Any = None
) -> tuple[ca.SX, ca.SX]:
    """Return the force, lb, and the moment about the center of gravity, ft lb, caused by a thrust.

    The thrust acts along the axis of the thruster. Both results are in body axes, (3,).

    thrust: lb.
    location: point of action, inches, or None for the location of the thruster.
    moment: additional moment of the thruster, body axes, ft lb, or None.
    """
    force = orientation(mounted)[:, 0] * thrust
    point = thruster_location(mounted) if location is None else location
    total = ca.cross(mounted.body.mass.arm(point), force)
    return force, total if moment is None else total + moment


def jet(mounted: MountedEngine, thrust: Any) -> Effect:
    """Return the `Effect` of an engine without propeller.

    A nozzle reduces the thrust by ambient pressure times area, but not below 0. A reverser
    multiplies the thrust of a direct thruster by the cosine of the reverser's angle.

    thrust: lb
    """
    if mounted.thruster.name == "nozzle":
        area = mounted.thruster.need("area").number("FT2")
        thrust = ca.fmax(thrust - mounted.motion.air.pressure * area, 0.0)
    if mounted.thruster.name == "direct":
        thrust = thrust * ca.cos(ca.SX(mounted.own("reverser-angle-rad", 0.0)))
    force, moment = thrust_force_and_moment(mounted, thrust)
    return Effect(force, moment, thrust)


def commanded_speed(mounted: MountedEngine, shaft: str) -> Any:
    """Return the speed of a running turbine's shaft that the throttle gives, %."""
    low, high = mounted.shaft(shaft)
    return low + ca.fmin(mounted.throttle, 1.0) * (high - low)


def spool_error(mounted: MountedEngine) -> Any:
    """Return the steady-state speed of a turbine's n2 shaft minus its present speed, %.

    The steady-state speed is given by the throttle. If the turbine does not run, it is the
    windmilling speed.
    """
    on = commanded_speed(mounted, "n2")
    wanted = ca.if_else(running(mounted), on, windmilling_speed(mounted, "n2"))
    return wanted - getattr(mounted.states, mounted.lag)


def windmilling_speed(mounted: MountedEngine, name: str) -> Any:
    """Return the windmilling speed of a turbine's shaft, %."""
    # The speed is 0 if the element disable-windmill is set. The divisors are those of JSBSim.
    if mounted.engine.value_of("disable-windmill", 0.0):
        return 0.0
    return mounted.motion.pressure_head / (10.0 if name == "n1" else 15.0)


def lag_rates(mounted: MountedEngine) -> dict[str, Any]:
    """Return {state: time derivative} for the lag of a turbine or turboprop.

    The result is empty if the lag is not a state.
    """
    state = mounted.lag_state
    rates = {}
    if mounted.kind == "turbine_engine" and state is not None:
        rates[mounted.lag] = _spool_rate(mounted, state)
    if mounted.kind == "turboprop_engine" and state is not None:
        rates[mounted.lag] = _generator_rate(mounted, state)
    return rates


def _generator_rate(mounted: MountedEngine, speed: ca.SX) -> Any:
    """Return the acceleration of a turboprop's gas generator, %/s (`FGTurboProp`)."""
    # It is the error of the speed divided by a time that depends on its sign and on whether the
    # engine runs. The factors are those of JSBSim.
    delay = mounted.engine.value_of("n1idle_max_delay", 1.0)
    is_on = running(mounted)
    on = _generator_speed(mounted)
    error = ca.if_else(is_on, on, mounted.motion.pressure_head / 15.0) - speed
    up = ca.if_else(is_on, delay, 2.5 * delay)
    down = ca.if_else(is_on, 2.4 * delay, 5.0 * delay)
    return error / ca.if_else(error > 0.0, up, down)


def _generator_speed(mounted: MountedEngine) -> Any:
    """Return the speed of a running turboprop's gas generator that the throttle gives, %."""
    low, high = mounted.shaft("n1")
    return low + mounted.throttle * (high - low)


def _spool_rate(mounted: MountedEngine, speed: ca.SX) -> Any:
    """Return the acceleration of a turbine's n2 shaft, %/s (`FGTurbine::Seek`)."""
    # The acceleration is at a limit until the target can be reached within one frame. The factors
    # are those of JSBSim.
    low, high = mounted.shaft("n2")
    is_on = running(mounted)
    power = ca.fmin((speed - low) / (high - low) + 0.1, 1.0)
    sigma = mounted.read("atmosphere/sigma")
    slowness = 1.0 + 3.0 * (1.0 - power) ** 3 + (1.0 - sigma)
    usual = 90.0 / (mounted.engine.value_of("bypassratio", 0.0) + 3.0) / slowness  # %/s
    least = 0.0 if mounted.engine.value_of("disable-windmill", 0.0) else 0.1
    up_if_on = _value_of_function(mounted, "N2SpoolUp", usual)
    down_if_on = _value_of_function(mounted, "N2SpoolDown", 3.0 * usual)
    up = ca.if_else(is_on, up_if_on, 0.5 * speed + least)
    down = ca.if_else(is_on, down_if_on, speed / mounted.engine.value_of("n2spindown", 2.0))
    return ca.fmin(ca.fmax(spool_error(mounted) / STEP, -down), up)


def turbine_thrust(mounted: MountedEngine) -> Any:
    """Return the thrust of a turbine, lb. A turbine that does not run has no thrust.

    Raises BadInputError if the function IdleThrust or MilThrust is missing.
    """
    engine = mounted.engine
    position = mounted.throttle
    military = engine.value_of("milthrust", 10000.0, "LBS")
    idle_share, military_share, augmented_share = (
        _value_of_function(mounted, name) for name in ("IdleThrust", "MilThrust", "AugThrust")
    )
    idle = military * idle_share
    power = ca.fmin(position, 1.0)
    speed = mounted.lag_state
    if speed is not None:  # of the n2 shaft
        low, high = mounted.shaft("n2")
        power = (speed - low) / (high - low)
    dry = idle + (military - idle) * military_share * power**2
    bleed = mounted.own("bleed-factor", engine.value_of("bleed", 0.0))
    bled = dry * (1.0 - bleed)
    strongest = engine.value_of("maxthrust", 10000.0, "LBS") * augmented_share
    thrust = _with_afterburner(mounted, dry, bled, strongest)
    return ca.if_else(running(mounted), thrust, 0.0)


def _with_afterburner(mounted: MountedEngine, dry: Any, bled: Any, strongest: Any) -> Any:
    """Return the thrust of a running turbine, lb, whose afterburner the throttle may light."""
    # dry, bled: thrust without afterburner, before and after the bleed, lb
    # strongest: thrust with full afterburner, lb
    engine = mounted.engine
    position = mounted.throttle
    method = int(engine.value_of("augmethod", 0.0))
    if method == 1 and engine.value_of("augmented", 0.0) == 1.0:  # lit at full throttle and speed
        speed = mounted.lag_state
        if speed is None:
            speed = commanded_speed(mounted, "n2")
        return ca.if_else(ca.logic_and(position > 0.99, speed > 97.0), strongest, bled)
    if method == 2:  # throttle positions from 1 to 2
        wet = dry + ca.fmin(position - 1.0, 1.0) * (strongest - dry)
        return ca.if_else(position > 1.0, wet, bled)
    return bled


def _value_of_function(mounted: MountedEngine, name: str, default: Any = 0.0) -> Any:
    """Return the value of a function of the engine's file, or `default` without it."""
    names = (name, f"propulsion/engine[#]/{name}", mounted.full_name(name))
    for function in mounted.engine.all("function"):
        if function.attributes.get("name", "") in names:
            return function_value(function, mounted.properties, mounted.number)
    if name in ("IdleThrust", "MilThrust"):
        raise mounted.engine.error(f"the turbine has no function {name}; add this function")
    return default


def rocket_thrust(mounted: MountedEngine) -> Any:
    """Return the thrust of a rocket in vacuum, lb: specific impulse times flow rate."""
    engine = mounted.engine
    throttle = mounted.throttle
    specific_impulse = engine.need("isp").number()
    flow = engine.value_of("propflowmax", 0.0, "LBS/SEC")
    if engine.find("slfuelflowmax") is not None:
        flow = engine.value_of("slfuelflowmax", 0.0, "LBS/SEC")
        flow += engine.value_of("sloxiflowmax", 0.0, "LBS/SEC")
    lowest = engine.value_of("minthrottle", 0.0)
    lit = ca.logic_and(running(mounted), throttle >= lowest)
    return ca.if_else(lit, specific_impulse * flow * throttle, 0.0)


def turboprop_power(mounted: MountedEngine) -> Any:
    """Return the power of a turboprop, hp (`FGTurboProp::Run`).

    Raises BadInputError if a table is missing.
    """
    engine = mounted.engine
    speed = mounted.lag_state
    if speed is None:
        speed = _generator_speed(mounted)
    tables = {table.attributes.get("name", ""): table for table in engine.all("table")}
    for name in ("EnginePowerRPM_N1", "ITT_N1"):  # without them JSBSim ends the program
        if name not in tables:
            raise engine.error(f"the turboprop has no table {name}; add this table")
    power = internal_table(tables["EnginePowerRPM_N1"], mounted.properties, [mounted.rpm, speed])
    factor = _value_of_function(mounted, "EnginePowerVC", None)
    if factor is None:
        if "EnginePowerVC" not in tables:
            raise engine.error("the turboprop has no table EnginePowerVC; add this table")
        factor = table_value(tables["EnginePowerVC"], mounted.properties, mounted.number)
    power = ca.fmin(power * factor, engine.need("maxpower").number())
    power = _within_torque(mounted, power)
    dragged = ca.if_else(mounted.rpm > 5.0, -0.012, 0.0)  # friction in JSBSim, hp
    return ca.if_else(running(mounted), power, dragged)


def _within_torque(mounted: MountedEngine, power: Any) -> Any:
    """Return the power of a turboprop, hp, at most that of its torque limit and a small share."""
    limiter = mounted.engine.find("ielumaxtorque")
    if limiter is None or not mounted.has_propeller:
        return power
    torque = limiter.number("FT*LB")
    turns = mounted.propeller_rpm / 60.0
    most = torque * ca.fmax(2.0 * np.pi * turns, 0.01) / HP
    statement = "the torque is limited to this value, about which JSBSim's limiter oscillates"
    subject = f"{torque:g} ft lb"
    mounted.properties.notes.append(Note(statement, subject, limiter.where, MOTION))
    # With a slope beyond the limit, by which a trim search returns below it.
    return ca.fmin(power, most + _SHARE_BEYOND_LIMIT * (power - most))


def electric_power(mounted: MountedEngine) -> Any:
    """Return the power of an electric engine, hp. An engine that does not run has no power."""
    power = mounted.engine.value_of("power", 745.7, "WATTS") * mounted.throttle / 745.7
    return ca.if_else(running(mounted), power, 0.0)


def internal_table(table: Element, properties: Properties, arguments: list[Any]) -> Any:
    """Return the value of a table whose arguments the engine supplies.

    A table with fewer axes uses the first arguments.

    Raises BadInputError if the table has more axes than arguments.
    """
    read = read_table(table)
    if read.dimensions > len(arguments):
        fault = (
            f"the table has {read.dimensions} axes, but the engine supplies {len(arguments)}"
            " arguments"
        )
        raise table.error(
            f"{fault}; give a table with fewer axes, or a propeller with variable pitch"
        )
    return read.at(properties, arguments[: read.dimensions])
