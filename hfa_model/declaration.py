"""Declaration of the paper's aircraft as a `Model`, with the range of its states."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hfa_aircraft.about import About, Domain, Trimming
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_model.atmosphere import air_at, refuse_beyond_the_atmosphere
from hfa_model.dynamics import aircraft_loads, rates_from_loads
from hfa_model.kinematics import DISTURBANCES, winds_of
from hfa_model.outputs import OUTPUTS, Instant
from hfa_model.parameters import (
    FIELDS,
    INPUT_SIGNALS,
    INPUTS,
    LINEAR_STATES,
    STATE_SIGNALS,
    STATES,
    Parameters,
    State,
    published_data,
)
from hfa_model.variants import Variant
from hfa_support.errors import BadInputError


@dataclass(frozen=True)
class VariantEquations:
    """Equations of motion of a variant, as the function (x, u, p, w) that `Model` requires.

    variant: variant of the equations
    """

    variant: Variant

    def __call__(
        self, x: Any, u: Any, p: Any, w: Any
    ) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return two mappings: state -> rate, and output -> value.

        x: states
        u: inputs
        p: parameters
        w: disturbances, in the order of `DISTURBANCES`
        """
        winds = winds_of(w)
        air = air_at(x.altitude)
        loads = aircraft_loads(x, u, air.density, p, self.variant, winds)
        rates = rates_from_loads(x, loads, p, self.variant)
        now = Instant(x, u, p, winds, air, loads, rates)
        return rates._asdict(), {name: output(now) for name, (_, output) in OUTPUTS.items()}


def check_in_range(x: State) -> None:
    """Raise BadInputError for a state outside the domain of the equations.

    The speed must be positive, the altitude within the atmosphere, and the dihedral angle below 90
    deg in magnitude.
    """
    if x.speed <= 0.0:
        raise BadInputError(f"speed is {x.speed:g} ft/s; give a positive speed")
    refuse_beyond_the_atmosphere(x.altitude)
    if not abs(x.dihedral) < np.pi / 2:
        raise BadInputError(
            f"dihedral is {np.degrees(x.dihedral):g} deg; give an angle above -90 and below 90 deg"
        )


def flight_limits(x: State, p: Parameters) -> dict[str, tuple[float, float]]:
    """Return the limits of the states in a simulation that begins near a trim, state -> (lowest,
    highest).

    speed: half to twice the trimmed speed V, ft/s, of the airspeed in moving air: the equations
        have the lift by the motion relative to the air
    altitude: within 1000 ft of the trim
    pitch_rate: up to V tan(α_max)/l_b, rad/s, at which the angle of attack at the tail, one boom
        length l_b behind, is α_max
    dihedral_rate: up to V tan(α_max)/(s/3), rad/s, at which the angle of attack at one third of the
        outer panel's span s is α_max

    The equations are not valid beyond these rates. The limits of alpha, pitch and dihedral are in
    `STATE_SIGNALS`.

    x: the trimmed state
    p: parameters
    """
    steepest_descent = x.speed * math.tan(STATE_SIGNALS.alpha.max)
    pitch_rate = steepest_descent / p.boom_length
    dihedral_rate = steepest_descent / (p.panel_span / 3)
    return {
        "speed": (0.5 * x.speed, 2.0 * x.speed),
        "altitude": (x.altitude - 1000.0, x.altitude + 1000.0),
        "pitch_rate": (-pitch_rate, pitch_rate),
        "dihedral_rate": (-dihedral_rate, dihedral_rate),
    }


#: Sensors: a pitot tube, a vane, an inertial unit in the center, angle sensors at the hinges.
#: Standard deviation of a sample, and size of a bias of a random sign in each flight.
SENSORS = {
    "airspeed": {"noise": "0.3 ft/s", "bias": "2 ft/s"},
    "angle_of_attack": {"noise": "0.17 deg", "bias": "1 deg"},
    "pitch": {"noise": "0.11 deg", "bias": "0.5 deg"},
    "pitch_rate": {"noise": "0.17 deg/s", "bias": "0.5 deg/s"},
    "dihedral": {"noise": "0.11 deg", "bias": "0.5 deg"},
    "dihedral_rate": {"noise": "0.17 deg/s", "bias": "0.5 deg/s"},
}

#: Unit of an output -> its typical size.
_TYPICAL = {
    "ft/s^2": 10.0,
    "rad": 0.1,
    "ft/s": 10.0,
    "ft lbf": 1000.0,
    "lbf": 100.0,
    "lbf/ft^2": 1.0,
}


def hfa_about(dynamics: str) -> About:
    """Return the texts about the flexible aircraft with dynamics of this name."""
    subject = "HFA" if dynamics == "published" else f"HFA ({dynamics})"
    game = published_data()["game"]  # of Section 5.1
    return About(
        title=f"{dynamics} dynamics",
        subject=subject,
        names_schedule=True,
        equations="published" if subject == "HFA" else "",  # other subjects name the equations
        atmosphere="U.S. Standard 1976",
        trained_at=math.radians(15.0),  # the dihedral of the printed (A1, B1)
        weights={
            "Q": dict(zip(LINEAR_STATES, game["Q_diag"], strict=True)),
            "R": dict(zip(INPUTS, game["R_diag"], strict=True)),
            "delta": game["delta"],
            "E": LINEAR_STATES,  # the disturbance acts on the rates of all of them
        },
        weights_source="default",
        sensors=SENSORS,
        sensors_source="assumed: the paper has no sensors",
        configuration=configuration,
    )


def configuration(x: Any, u: Any, p: Any) -> dict[str, tuple[float, str]]:
    """Return mass, inertias about the common center of mass, and sizes, name -> (value, unit).

    With dihedral η and span s of a panel, Iyy = c1 + c2 sin² η (`hfa_model.dynamics`) and
    b = s (1 + 2 cos η).

    x: (n,), states, which begin with those of `STATES`
    u: inputs
    p: (k,), parameters, which begin with those of `Parameters`
    """
    values = Parameters(*p[: len(Parameters._fields)])
    eta = float(x[STATES.index("dihedral")])
    m, s = values.panel_mass, values.panel_span
    pitch, yaw = values.inertia_pitch, values.inertia_yaw
    sine, cosine = math.sin(eta), math.cos(eta)
    outward = 2.0 * m * (s / 2.0 * (1.0 + cosine)) ** 2  # sum of m y² of the outer panels
    upward = m * (s * sine) ** 2 / 6.0  # of m z²: one panel (s/3) sin η, two (s/6) sin η away
    inertia = "slug ft^2"
    return {
        "mass": (3.0 * m, "slug"),
        "Ixx": (3.0 * values.inertia_roll + outward + upward, inertia),
        "Iyy": (pitch + 2.0 * (pitch * cosine**2 + yaw * sine**2) + upward, inertia),
        "Izz": (yaw + 2.0 * (yaw * cosine**2 + pitch * sine**2) + outward, inertia),
        "reference_area": (3.0 * s * values.chord, "ft^2"),
        "reference_span": (s * (1.0 + 2.0 * cosine), "ft"),
        "reference_chord": (values.chord, "ft"),
    }


@lru_cache(maxsize=64)
def rigid_panels(
    variant: Variant,
    parameters: Parameters,
    describe_trim: Callable[[Any], Any] | None = None,
) -> Model:
    """Return the flexible aircraft as a model with the equations of a variant, in quasi-steady air.

    The parameters are not checked.

    describe_trim: `Trimming.describe` of the model
    """
    paper = published_data()["trim"]
    return Model(
        name=variant.name,
        # Points have states and inputs of the classes of these named tuples, `State` and `Input`.
        states=STATE_SIGNALS,  # type: ignore[arg-type]  # a named tuple
        inputs=INPUT_SIGNALS,  # type: ignore[arg-type]  # a named tuple
        equations=VariantEquations(variant),
        # The values are not checked: a fit of the printed matrices also tries impossible ones.
        parameters={
            name: Signal(unit, min=0.0 if positive else -math.inf, start=float(value))
            for value, (name, (unit, _, positive)) in zip(
                parameters, FIELDS._asdict().items(), strict=True
            )
        },
        disturbances={name: Signal("ft/s", 10.0) for name in DISTURBANCES},
        outputs={
            name: Signal(unit, _TYPICAL.get(unit, 1.0)) for name, (unit, _) in OUTPUTS.items()
        },
        # The paper's level flight (Section 5.1), but with a flat wing.
        trim={
            "speed": paper["speed"],
            "alpha": math.radians(paper["alpha_deg"]),
            "altitude": paper["altitude"],
            "gamma": 0.0,
            "pitch_rate": paper["pitch_rate"],
            "dihedral": 0.0,
            "dihedral_rate": paper["dihedral_rate"],
            "aileron_center": 0.0,
        },
        steady=tuple(name for name in STATES if name != "altitude"),
        linear=LINEAR_STATES,
        schedule="dihedral",
        modes={
            "short period": ("alpha", "pitch_rate"),
            "phugoid": ("speed", "pitch"),
            "dihedral": ("dihedral", "dihedral_rate"),
            "altitude": ("altitude",),
        },
        replaced={"pitch": "gamma"},
        # For the vertical acceleration, A_z in SimVFA.
        parts={"short_period": ("alpha",)},
        domain=Domain(
            # The paper calls its linear model applicable up to this dihedral angle (Section 5.1).
            range={"dihedral": (-math.radians(15.0), math.radians(15.0), "the paper's range")},
            envelope=flight_limits,
            check=check_in_range,
        ),
        trimming=Trimming(describe=describe_trim),
        about=hfa_about(variant.name),
    )


def is_hfa(model: Model) -> bool:
    """Return whether a model is the paper's aircraft with the equations of a `Variant`."""
    return isinstance(model.native.equations, VariantEquations)


def parameters_of(model: Model) -> Parameters:
    """Return the parameters of a model of the paper's aircraft, in the units of the model.

    Additional parameters of the unsteady dynamics are omitted.
    """
    return Parameters(*(model.parameters[name].start for name in Parameters._fields))


def variant_of(model: Model) -> Variant:
    """Return the variant of the equations of a model for which `is_hfa` is true."""
    equations: VariantEquations = model.native.equations  # type: ignore[assignment]  # of an HFA
    return equations.variant
