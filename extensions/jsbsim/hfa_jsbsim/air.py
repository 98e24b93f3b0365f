"""Atmosphere, airflow, velocity and attitude (`FGStandardAtmosphere`, `FGAuxiliary`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca

from hfa_aircraft.rigid.aircraft import angular_velocity, rotation, turn_rate, wind_axes
from hfa_aircraft.rigid.atmosphere import (
    SEA_LEVEL,
    Air,
    air_at,
    calibrated_speed,
    density_altitude,
    pitot_pressure,
)
from hfa_jsbsim.airframe import Mass, Metrics
from hfa_support.units import FOOT, KNOT

#: Knot, ft/s.
KNOT_IN_FEET = KNOT / FOOT
#: Sutherland's temperature, °R, and factor of the viscosity of air, slug/(ft s √°R).
_SUTHERLAND = 198.72
_VISCOSITY = 2.269690e-08


@dataclass(frozen=True)
class Winds:
    """Velocity of the air relative to the ground in north, east and down, ft/s, (3,) each.

    steady: steady wind, to which the states are relative
    gusts: gusts at the aircraft, relative to the steady wind, or None in calm air
    """

    steady: Any
    gusts: Any = None


@dataclass(frozen=True)
class Motion:
    """Motion of the aircraft with derived quantities. In gusts the airflow differs from the states.

    speed, alpha, beta, air_velocity: airflow at the aircraft, ft/s and rad, body axes.
    altitude: ft.
    velocity: velocity of the states, relative to the steady wind, body axes, ft/s.
    over_ground, ned: velocity relative to the ground, in body axes and in north, east, down, ft/s.
    rates: angular velocity, body axes, rad/s.
    to_body: rotation matrix from north, east, down to body axes, (3, 3).
    down: direction of gravity in body axes, (3,).
    wind_to_body: rotation matrix (3, 3) of `FGAuxiliary::UpdateWindMatrices`.
    climb: climb rate relative to the ground, ft/s.
    pressure_head: dynamic pressure, lb/ft².
    mach: Mach number of the airflow.
    calibrated: calibrated airspeed, ft/s.
    air: atmosphere at the altitude.
    """

    speed: Any
    alpha: Any
    beta: Any
    altitude: Any
    air_velocity: ca.SX
    velocity: ca.SX
    over_ground: ca.SX
    ned: ca.SX
    rates: ca.SX
    to_body: ca.SX
    down: ca.SX
    wind_to_body: ca.SX
    climb: Any
    pressure_head: Any
    mach: Any
    calibrated: Any
    air: Air


def motion_of(x: Any, winds: Winds, warmer: Any) -> Motion:
    """Return the motion of the aircraft with derived quantities, for given states and winds.

    x: object with the model's states as attributes
    warmer: deviation of the temperature from that of the standard atmosphere, K
    """
    to_body = rotation(x.roll, x.pitch, x.yaw).T
    wind_axes_of_states = wind_axes(x.alpha, x.beta)  # columns are the axes; the first is forward
    velocity = x.speed * wind_axes_of_states[:, 0]
    over_ground = velocity + ca.mtimes(to_body, winds.steady)
    ned = ca.mtimes(to_body.T, over_ground)
    speed = x.speed
    alpha = x.alpha
    beta = x.beta
    air_velocity = velocity
    wind_to_body = wind_axes_of_states
    if winds.gusts is not None:
        air_velocity = velocity - ca.mtimes(to_body, winds.gusts)
        speed = ca.norm_2(air_velocity)
        alpha = ca.atan2(air_velocity[2], air_velocity[0])
        beta = ca.asin(air_velocity[1] / speed)
        wind_to_body = wind_axes(alpha, beta)
    air = air_at(x.altitude, "english", warmer)
    mach = speed / air.sound
    return Motion(
        speed=speed,
        alpha=alpha,
        beta=beta,
        altitude=x.altitude,
        air_velocity=air_velocity,
        velocity=velocity,
        over_ground=over_ground,
        ned=ned,
        rates=angular_velocity(x),
        to_body=to_body,
        down=to_body[:, 2],
        wind_to_body=wind_to_body,
        climb=-ned[2],
        pressure_head=0.5 * air.density * speed**2,
        mach=mach,
        calibrated=calibrated_speed(mach, air.pressure),
        air=air,
    )


def state_properties(x: Any, motion: Motion, metrics: Metrics) -> dict[str, Any]:
    """Return name -> value of the JSBSim properties that follow from states, wind and geometry.

    The ground is at sea level.

    x: object with the model's states as attributes
    """
    u, v, w = ca.vertsplit(motion.air_velocity)
    uvw_over_ground = ca.vertsplit(motion.over_ground)
    north, east, down = ca.vertsplit(motion.ned)
    air = motion.air
    total_temperature = air.temperature * (1.0 + 0.2 * motion.mach**2)  # 0.2 = (1.4 - 1) / 2
    viscosity = _VISCOSITY * air.temperature**1.5 / (_SUTHERLAND + air.temperature)
    ground_speed = ca.sqrt(ca.fmax(north**2 + east**2, 1e-12))  # with a finite slope at 0
    track = ca.atan2(east, north)
    turning = turn_rate(x)
    values = {
        "velocities/vt-fps": motion.speed,
        "velocities/mach": motion.mach,
        "velocities/vg-fps": ground_speed,
        "velocities/h-dot-fps": motion.climb,
        "velocities/v-north-fps": north,
        "velocities/v-east-fps": east,
        "velocities/v-down-fps": down,
        "velocities/phidot-rad_sec": x.roll_rate + turning * ca.sin(x.pitch),
        "velocities/thetadot-rad_sec": x.pitch_rate * ca.cos(x.roll) - x.yaw_rate * ca.sin(x.roll),
        "velocities/psidot-rad_sec": turning,
        "aero/alpha-wing-rad": motion.alpha + metrics.incidence,
        "aero/qbar-psf": motion.pressure_head,
        "aero/qbarUW-psf": 0.5 * air.density * (u**2 + w**2),
        "aero/qbarUV-psf": 0.5 * air.density * (u**2 + v**2),
        "aero/qbar-area": motion.pressure_head * metrics.area,
        "aero/Re": motion.speed * metrics.chord * air.density / viscosity,
        "aero/bi2vel": metrics.span / (2.0 * motion.speed),
        "aero/ci2vel": metrics.chord / (2.0 * motion.speed),
        "flight-path/psi-gt-rad": ca.if_else(track < 0.0, track + 2.0 * math.pi, track),
        "position/h-sl-ft": x.altitude,
        "position/h-agl-ft": x.altitude,
        "position/geod-alt-ft": x.altitude,
        "position/h-sl-meters": x.altitude * FOOT,
        "position/h-agl-km": x.altitude * FOOT / 1000.0,
        "propulsion/tat-r": total_temperature,
        "propulsion/tat-c": (total_temperature - 491.67) / 1.8,
        "propulsion/pt-lbs_sqft": pitot_pressure(motion.mach, air.pressure),
        "atmosphere/T-R": air.temperature,
        "atmosphere/P-psf": air.pressure,
        "atmosphere/rho-slugs_ft3": air.density,
        "atmosphere/a-fps": air.sound,
        "atmosphere/T-sl-R": SEA_LEVEL.temperature,
        "atmosphere/P-sl-psf": SEA_LEVEL.pressure,
        "atmosphere/rho-sl-slugs_ft3": SEA_LEVEL.density,
        "atmosphere/a-sl-fps": SEA_LEVEL.sound,
        "atmosphere/theta": air.temperature / SEA_LEVEL.temperature,
        "atmosphere/delta": air.pressure / SEA_LEVEL.pressure,
        "atmosphere/sigma": air.density / SEA_LEVEL.density,
        "atmosphere/pressure-altitude": x.altitude,
        "atmosphere/density-altitude": density_altitude(air.density),
    }
    for letter, rate in zip("pqr", (x.roll_rate, x.pitch_rate, x.yaw_rate), strict=True):
        values |= {f"velocities/{letter}{kind}-rad_sec": rate for kind in ("", "-aero")}
    for letter, in_air, over_ground in zip("uvw", (u, v, w), uvw_over_ground, strict=True):
        values[f"velocities/{letter}-aero-fps"] = in_air
        values[f"velocities/{letter}-fps"] = over_ground
    equivalent = ca.sqrt(2.0 * motion.pressure_head / SEA_LEVEL.density)
    airspeeds = {"vtrue": motion.speed, "vc": motion.calibrated, "ve": equivalent}
    for name, airspeed in airspeeds.items():
        values[f"velocities/{name}-fps"] = airspeed
        values[f"velocities/{name}-kts"] = airspeed / KNOT_IN_FEET
    angles = {
        "aero/alpha": motion.alpha,
        "aero/beta": motion.beta,
        "aero/mag-beta": ca.fabs(motion.beta),
        "flight-path/gamma": ca.atan2(motion.climb, ground_speed),
        **dict.fromkeys(("attitude/phi", "attitude/roll"), x.roll),
        **dict.fromkeys(("attitude/theta", "attitude/pitch"), x.pitch),
        **dict.fromkeys(("attitude/psi", "attitude/heading-true"), x.yaw),
    }
    for name, angle in angles.items():
        values[f"{name}-rad"] = angle
        values[f"{name}-deg"] = angle * (180.0 / math.pi)
    return values | _sizes(metrics)


def _sizes(metrics: Metrics) -> dict[str, Any]:
    """Return the values of JSBSim's properties of the geometry, by name such as metrics/bw-ft."""
    values = {
        "metrics/Sw-sqft": metrics.area,
        "metrics/bw-ft": metrics.span,
        "metrics/cbarw-ft": metrics.chord,
        "metrics/iw-rad": metrics.incidence,
        "metrics/iw-deg": metrics.incidence * 180.0 / math.pi,
        "metrics/Sh-sqft": metrics.tail_area,
        "metrics/lh-ft": metrics.tail_arm,
        "metrics/Sv-sqft": metrics.fin_area,
        "metrics/lv-ft": metrics.fin_arm,
    }
    for axis, letter in enumerate("xyz"):
        values[f"metrics/aero-rp-{letter}-in"] = metrics.reference_point[axis]
    return values


def mass_properties(mass: Mass) -> dict[str, Any]:
    """Return name -> value of JSBSim's properties of mass, inertia and center of gravity."""
    values = {
        "inertia/mass-slugs": mass.slugs,
        "inertia/weight-lbs": mass.weight,
    }
    for axis, letter in enumerate("xyz"):
        values[f"inertia/cg-{letter}-in"] = mass.center[axis]
    return values


#: Names of the properties in `mass_properties`.
OF_MASS = tuple(mass_properties(Mass(0.0, ca.DM.zeros(3), ca.DM.zeros(3, 3))))
