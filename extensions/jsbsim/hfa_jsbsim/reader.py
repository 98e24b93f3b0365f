"""An aircraft of JSBSim as a `Model`: where its files are, names, limits, where a search begins."""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_jsbsim.air import (
    KNOT,
    SEA_LEVEL,
    air_at,
    mach_of_calibrated,
    subsonic_mach_of_calibrated,
)
from hfa_jsbsim.aircraft import STATES, Equations, Parts
from hfa_jsbsim.airframe import SLUG_TO_LB
from hfa_jsbsim.engines import EngineFile
from hfa_jsbsim.reasons import explain, of_files
from hfa_jsbsim.xml_file import Folders
from hfa_support.errors import BadInputError, shortened

#: Outputs that are the positions of surfaces: name -> property, in rad.
_POSITIONS = {
    "elevator_position": "fcs/elevator-pos-rad",
    "left_aileron_position": "fcs/left-aileron-pos-rad",
    "right_aileron_position": "fcs/right-aileron-pos-rad",
    "rudder_position": "fcs/rudder-pos-rad",
}
#: JSBSim's names, in the same units as typed: angles in degrees.
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
#: Advance ratio V / (n D) where a search for the speed of a propeller begins.
_ADVANCE_RATIO = 0.72
_MODES = {
    "short period": ("alpha", "pitch_rate"),
    "phugoid": ("speed", "pitch"),
    "dutch roll": ("beta", "yaw_rate"),
    "roll": ("roll_rate",),
    "spiral": ("roll",),
}


def read_model(text: str, partial: bool = False) -> Model:
    """The `Model` of "jsbsim:NAME" or of an aircraft's XML file.

    partial: leave out motors, rotors and gas cells, which cannot be read, in place of refusing
    them. BadInputError, with file and line, where an element cannot be read.
    """
    path, folders = _find(text)
    parts = Parts(path, folders, partial)
    return _Declaration(parts, Equations(parts)).model((text, folders.digest))


def _find(text: str) -> tuple[Path, Folders]:
    """The file that a text names, and where its parts may come from."""
    root = data_folder()
    if text.startswith("jsbsim:"):
        path = _in_data(text.removeprefix("jsbsim:"), root)
    else:
        path = Path(text).resolve()
    shared = [path.parent.parent.parent]
    if root is not None and root.resolve() not in shared:
        shared.append(root.resolve())
    return path, Folders(path.parent, tuple(shared))


def _in_data(name: str, root: Path | None) -> Path:
    """The file of an aircraft of JSBSim."""
    if root is None:
        raise BadInputError(
            f"jsbsim:{shortened(name)}: there is no JSBSim here; install the package jsbsim, or set"
            " JSBSIM_ROOT to the folder that holds aircraft, engine and systems"
        )
    folders = sorted(folder.name for folder in (root / "aircraft").iterdir() if folder.is_dir())
    if name not in folders:
        raise BadInputError(
            f"no aircraft of JSBSim {shortened(name)!r}; choose from {', '.join(folders)}"
        )
    return (root / "aircraft" / name / f"{name}.xml").resolve()


def data_folder() -> Path | None:
    """The folder of JSBSim's data, which holds `aircraft`, `engine` and `systems`: $JSBSIM_ROOT, or
    that of the installed package jsbsim, which is not imported. None without both.

    BadInputError when $JSBSIM_ROOT holds no folder `aircraft`.
    """
    root = os.environ.get("JSBSIM_ROOT")
    if root:
        if not (Path(root) / "aircraft").is_dir():
            raise BadInputError(f"JSBSIM_ROOT is {shortened(root)}; it holds no folder aircraft")
        return Path(root)
    package = importlib.util.find_spec("jsbsim")
    if package is None or not package.submodule_search_locations:
        return None
    return Path(next(iter(package.submodule_search_locations)))


class EquationsOfMotion:
    """(x, u, p, w) -> rates by state, outputs by name, of numbers or expressions."""

    def __init__(self, function: ca.Function, rates: list[str], outputs: list[str]) -> None:
        self.function = function
        self._rates = rates
        self._outputs = outputs

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Rates and outputs."""
        columns = [ca.vertcat(*vector) if len(vector) else ca.DM(0, 1) for vector in (x, u, p)]
        rates, outputs = self.function(*columns)
        if isinstance(rates, ca.DM):
            split = [column.full().ravel().tolist() for column in (rates, outputs)]
        else:
            split = [ca.vertsplit(column) for column in (rates, outputs)]
        return (
            dict(zip(self._rates, split[0], strict=True)),
            dict(zip(self._outputs, split[1], strict=True)),
        )


class _Declaration:
    """Names, units, sizes and limits of an aircraft's equations."""

    def __init__(self, parts: Parts, equations: Equations) -> None:
        self.parts = parts
        self.equations = equations
        every = ca.vertcat(*equations.rates.values(), *equations.outputs.values())
        self.inputs = {
            name: pilot_input
            for name, pilot_input in equations.inputs.items()
            if ca.depends_on(every, pilot_input.symbol)
        }
        self.parameters = {
            name: symbol
            for name, symbol in equations.parameters.items()
            if name == "gravity" or ca.depends_on(every, symbol)
        }
        pressure = parts.mass.weight / max(parts.wings.area, 1e-6)
        #: True speed at sea level with a lift coefficient of 0.5, ft/s.
        self.usual_speed = math.sqrt(2.0 * pressure / (SEA_LEVEL.density * 0.5))

    def model(self, source: tuple[str, str]) -> Model:
        """The declaration."""
        states = self._states()
        outputs = self._outputs()
        steady = tuple(name for name in states if name not in ("yaw", "altitude"))
        notes = [*of_files(self.parts), *self.parts.notes, *self.equations.notes]
        for name, where in self.equations.properties.unset.items():
            notes.append(f"{where}: nothing sets {name}; it is 0")
        return Model(
            self.parts.name,
            states,
            self._inputs(),
            self._function(list(outputs)),
            parameters=self._parameters(),
            outputs=outputs,
            trim=self._trim(),
            steady=steady,
            linear=steady,
            schedule="speed",
            modes=_MODES | self._propeller_modes(),
            source=source,
            notes=tuple(notes),
            alternatives=(("speed", "kcas", "mach"),),
            aliases=ALIASES,
            begin=self._beginning(),
            explain=partial(explain, self.parts),
        )

    def _states(self) -> dict[str, Signal]:
        """Signals of the states."""
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
        ordered = {name: signals[name] for name in STATES}
        for file in self.parts.engines:
            if file.has_propeller:
                ordered[f"rpm{file.number}"] = _rpm(file)
            if file.governed:
                lowest = file.thruster.value_of("minpitch", 0.0)
                highest = file.thruster.value_of("maxpitch", 0.0)
                middle = 0.5 * (lowest + highest)
                ordered[f"blade{file.number}"] = Signal("deg", 5.0, lowest, highest, middle, 100.0)
        return ordered

    def _inputs(self) -> dict[str, Signal]:
        """Signals of the inputs."""
        signals = {}
        for name, pilot_input in self.inputs.items():
            start = 0.6 if name == "throttle" else 0.0
            signals[name] = Signal(pilot_input.unit, 0.1, *pilot_input.limits, start)
        return signals

    def _parameters(self) -> dict[str, Signal]:
        """Signals of the levers and of gravity."""
        starts = {"mixture": 1.0, "advance": 1.0}
        signals = {name: Signal(start=starts.get(name, 0.0)) for name in self.parameters}
        signals["gravity"] = Signal("ft/s^2", 32.0, start=SLUG_TO_LB)
        return signals

    def _outputs(self) -> dict[str, Signal]:
        """Signals of the outputs; positions of surfaces that commands move are added to them."""
        signals_by_name = {
            "kcas": Signal("kt", 100.0),
            "mach": Signal("1", 0.5),
            "gamma": Signal("rad", 0.1),
            "turn_rate": Signal("rad/s", 0.1),
            "load_factor": Signal(),
            "lift_to_weight": Signal(),
            "thrust": Signal("lbf", 0.1 * self.parts.mass.weight),
        }
        signals = {
            name: signals_by_name.get(name, Signal("hp", 100.0)) for name in self.equations.outputs
        }
        for name, full_name in _POSITIONS.items():
            key = name.removesuffix("_position").removeprefix("left_").removeprefix("right_")
            if self.equations.properties.writer(full_name) is None:
                continue
            if key in self.inputs and self.inputs[key].unit == "1":
                value = self.equations.properties.read(full_name, "")
                self.equations.outputs[name] = ca.SX(value)
                signals[name] = Signal("rad", 0.1)
        return signals

    def _function(self, outputs: list[str]) -> EquationsOfMotion:
        """The equations as one Function of states, inputs and parameters; inputs that move nothing
        are 0."""
        equations = self.equations
        rates = ca.vertcat(*equations.rates.values())
        others = ca.vertcat(*(equations.outputs[name] for name in outputs))
        symbols = [pilot_input.symbol for pilot_input in equations.inputs.values()]
        symbols += [*equations.parameters.values(), *equations.rate_symbols]
        kept = {pilot_input.symbol.element_hash() for pilot_input in self.inputs.values()}
        kept |= {symbol.element_hash() for symbol in self.parameters.values()}
        left_out = [symbol for symbol in symbols if symbol.element_hash() not in kept]
        rates, others = ca.substitute(
            [rates, others],
            [ca.vertcat(*left_out)],
            [ca.SX.zeros(len(left_out))],
        )
        arguments = [
            ca.vertcat(*equations.states.values()),
            ca.vertcat(ca.SX(0, 1), *(pilot_input.symbol for pilot_input in self.inputs.values())),
            ca.vertcat(*self.parameters.values()),
        ]
        values = [ca.densify(part) for part in ca.cse([rates, others])]
        function = ca.Function("jsbsim", arguments, values)
        return EquationsOfMotion(function, list(equations.rates), outputs)

    def _trim(self) -> dict[str, float]:
        """Straight level flight; without a throttle the path is free, without two inputs across the
        sideslip."""
        imposed = {"speed": self.usual_speed, "altitude": 5000.0, "yaw": 0.0, "turn_rate": 0.0}
        if "throttle" in self.inputs:
            imposed["gamma"] = 0.0
        if {"aileron", "rudder"} <= set(self.inputs):
            imposed["beta"] = 0.0
        return imposed

    def _propeller_modes(self) -> dict[str, tuple[str, ...]]:
        """Modes of propellers and governors."""
        modes: dict[str, tuple[str, ...]] = {}
        for file in self.parts.engines:
            if file.has_propeller:
                modes[f"propeller {file.number}"] = (f"rpm{file.number}",)
            if file.governed:
                modes[f"governor {file.number}"] = (f"blade{file.number}",)
        return modes

    def _beginning(self) -> Callable[[Mapping[str, Any]], Mapping[str, Any]]:
        """A function that gives starting values of a trim from the imposed ones.

        The speed is the true speed of kcas or mach, the angle of attack follows the lift
        coefficient of level flight, propellers turn at a usual advance ratio. Values are numbers,
        or arrays of one length."""
        usual_speed = self.usual_speed
        propellers = [
            (f"rpm{file.number}", file.thruster.value_of("diameter", 0.001, "FT"), _rpm(file).start)
            for file in self.parts.engines
            if file.has_propeller and not file.governed
        ]

        def begin(imposed: Mapping[str, Any]) -> dict[str, Any]:
            """Starting values by name; {} where no altitude or no positive speed is imposed.

            imposed: values by name: speed (ft/s), mach or kcas, altitude (ft), gamma (rad)
            """
            altitude = imposed.get("altitude")
            if altitude is None:
                return {}
            speed, density = _speed_and_density(imposed, altitude)
            if speed is None or np.min(speed) <= 0.0:
                return {}
            lift_coefficient = 0.5 * (usual_speed / speed) ** 2 * SEA_LEVEL.density / density
            alpha = np.clip(0.2 * (lift_coefficient - 0.25), -0.05, 0.25)
            values = {"speed": speed, "alpha": alpha, "pitch": alpha + imposed.get("gamma", 0.0)}
            for name, diameter, usual_rpm in propellers:
                rpm = 60.0 * speed / (_ADVANCE_RATIO * diameter)
                values[name] = np.clip(rpm, 0.5 * usual_rpm, 1.1 * usual_rpm)
            return values

        return begin


def _speed_and_density(imposed: Mapping[str, Any], altitude: Any) -> tuple[Any, Any]:
    """True speed, ft/s, of an imposed speed, Mach number or calibrated airspeed, None without them,
    and density, slug/ft^3: numbers, or arrays of one length."""
    calibrated = imposed.get("kcas", 0.0)
    subsonic, sound, density = _at("subsonic", calibrated, altitude)
    if "speed" in imposed:
        return imposed["speed"], density
    if "mach" in imposed:
        return imposed["mach"] * sound, density
    if "kcas" not in imposed:
        return None, density
    if np.max(subsonic) > 1.0:
        (mach,) = _at("mach", calibrated, altitude)
        return mach * sound, density
    return subsonic * sound, density


@lru_cache
def _functions() -> dict[str, ca.Function]:
    """(calibrated airspeed in kt, altitude in ft) -> Mach number if it is below 1, speed of sound,
    ft/s, density, slug/ft^3; and -> any Mach number."""
    speed = ca.SX.sym("speed")
    altitude = ca.SX.sym("altitude")
    air = air_at(altitude)
    subsonic = subsonic_mach_of_calibrated(speed * KNOT, air.pressure)
    any_mach = mach_of_calibrated(speed * KNOT, air.pressure)
    return {
        "subsonic": ca.Function("air", [speed, altitude], [subsonic, air.sound, air.density]),
        "mach": ca.Function("mach", [speed, altitude], [any_mach]),
    }


def _at(name: str, speed: Any, altitude: Any) -> list[Any]:
    """What one of `_functions` gives at numbers, or at arrays of one length."""
    arguments = [np.atleast_2d(speed), np.atleast_2d(altitude)]
    results = _functions()[name].call(arguments)
    arrays = [result.full().ravel() for result in results]
    return [float(array[0]) if array.size == 1 else array for array in arrays]


def _rpm(file: EngineFile) -> Signal:
    """The signal of a propeller's speed."""
    prop = file.thruster
    ratio = max(prop.value_of("gearratio", 1.0), 0.001)
    usual = prop.value_of("maxrpm", 0.0)
    lowest = 10.0
    if file.kind == "piston_engine":
        lowest = 0.8 * file.engine.value_of("idlerpm", 600.0) / ratio
        usual = usual or 0.85 * file.engine.value_of("maxrpm", 2800.0) / ratio
    usual = usual or 2000.0
    return Signal("rpm", 0.1 * usual, lowest, 10.0 * usual, 0.9 * usual, rate=usual)
