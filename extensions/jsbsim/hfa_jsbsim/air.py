"""The air, and what follows from state and air: properties of atmosphere, aero, velocities,
attitude (`FGStandardAtmosphere`, `FGAuxiliary`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

from hfa_jsbsim.airframe import Mass, Metrics

FT_TO_M = 0.3048
KNOT = 1852.0 / (3600.0 * FT_TO_M)
_HEAT_RATIO = 1.4
_STANDARD_GRAVITY = 9.80665 / FT_TO_M
_EARTH_RADIUS = 6356766.0 / FT_TO_M
_KG_TO_SLUG = 0.06852168
_GAS_CONSTANT = (8.31432 * _KG_TO_SLUG / (FT_TO_M * FT_TO_M * 1.8)) / (
    28.9645 * _KG_TO_SLUG / 1000.0
)
_SEA_LEVEL_PRESSURE = 2116.228
#: Geopotential altitude, ft, and temperature, R.
_LAYERS = (
    (0.0, 518.67),
    (36089.2388, 389.97),
    (65616.7979, 389.97),
    (104986.8766, 411.57),
    (154199.4751, 487.17),
)
_SUTHERLAND = 198.72
_VISCOSITY = 2.269690e-08


@dataclass(frozen=True)
class Air:
    """temperature: R. pressure: psf. density: slug/ft^3. sound: its speed, ft/s."""

    temperature: Any
    pressure: Any
    density: Any
    sound: Any


def air_at(altitude: Any) -> Air:
    """Standard air at a geometric altitude, ft; up to 154,000 ft."""
    height = altitude * _EARTH_RADIUS / (_EARTH_RADIUS + altitude)
    base_pressure = _SEA_LEVEL_PRESSURE
    temperature: Any = 0.0
    pressure: Any = 0.0
    for (bottom, warmth), (top, next_warmth) in pairwise(_LAYERS):
        lapse = (next_warmth - warmth) / (top - bottom)
        layer_temperature = warmth + lapse * (height - bottom)
        layer_pressure = base_pressure * _pressure_ratio(warmth, lapse, height - bottom)
        if bottom:
            temperature = ca.if_else(height < bottom, temperature, layer_temperature)
            pressure = ca.if_else(height < bottom, pressure, layer_pressure)
        else:
            temperature = layer_temperature
            pressure = layer_pressure
        base_pressure = float(base_pressure * _pressure_ratio(warmth, lapse, top - bottom))
    sound = ca.sqrt(_HEAT_RATIO * _GAS_CONSTANT * temperature)
    return Air(temperature, pressure, pressure / (_GAS_CONSTANT * temperature), sound)


def _pressure_ratio(warmth: float, lapse: float, climb: Any) -> Any:
    """Pressure at a height above the bottom of a layer, relative to the pressure there."""
    if lapse == 0.0:
        return ca.exp(-_STANDARD_GRAVITY * climb / (_GAS_CONSTANT * warmth))
    return (warmth / (warmth + lapse * climb)) ** (_STANDARD_GRAVITY / (_GAS_CONSTANT * lapse))


SEA_LEVEL = air_at(ca.DM(0.0))
SEA_LEVEL = Air(*(float(value) for value in vars(SEA_LEVEL).values()))


def pitot_pressure(mach: Any, pressure: Any) -> Any:
    """Total pressure behind the shock of a pitot tube: isentropic below Mach 1, Rayleigh's formula
    above."""
    coefficient = 1.2**3.5 * 6.0**2.5
    fast = ca.fmax(mach, 1.0)
    supersonic = coefficient * fast**7.0 / (7.0 * fast * fast - 1.0) ** 2.5
    return pressure * ca.if_else(mach < 1.0, (1.0 + 0.2 * mach * mach) ** 3.5, supersonic)


def mach_of_pitot(impact_pressure: Any, pressure: Any) -> Any:
    """The Mach number at which a pitot tube shows this pressure above the static one."""
    ratio = impact_pressure / pressure + 1.0
    subsonic = _subsonic_mach(ratio)
    coefficient = 1.2 ** (-0.25 * 7.0) * (1.2 / 1.4) ** (-0.5 * 2.5)
    supersonic = ca.fmax(subsonic, 1.0)
    for _ in range(10):
        supersonic = coefficient * ca.sqrt(ratio * (1.0 - 1.0 / (7.0 * supersonic**2)) ** 2.5)
    return ca.if_else(subsonic > 1.0, supersonic, subsonic)


def _subsonic_mach(ratio: Any) -> Any:
    """The Mach number, at most 1, at a ratio of total to static pressure."""
    return ca.sqrt(5.0 * (ratio ** (2.0 / 7.0) - 1.0))


def calibrated_speed(mach: Any, pressure: Any) -> Any:
    """What an airspeed indicator that is calibrated at sea level shows, ft/s."""
    impact = pitot_pressure(mach, pressure) - pressure
    return SEA_LEVEL.sound * mach_of_pitot(impact, _SEA_LEVEL_PRESSURE)


def mach_of_calibrated(speed: Any, pressure: Any) -> Any:
    """The Mach number at a calibrated airspeed, ft/s."""
    impact = pitot_pressure(speed / SEA_LEVEL.sound, _SEA_LEVEL_PRESSURE) - _SEA_LEVEL_PRESSURE
    return mach_of_pitot(impact, pressure)


def subsonic_mach_of_calibrated(speed: Any, pressure: Any) -> Any:
    """The same where calibrated airspeed and Mach number are below those of sound."""
    total = (1.0 + 0.2 * (speed / SEA_LEVEL.sound) ** 2) ** 3.5
    return _subsonic_mach((total - 1.0) * _SEA_LEVEL_PRESSURE / pressure + 1.0)


@dataclass(frozen=True)
class Motion:
    """A state with what follows from it at once.

    velocity: body axes, ft/s. rates: of rotation, rad/s. down: the vertical in body axes.
    wind_to_body: (3, 3) `FGAuxiliary::UpdateWindMatrices`. climb: ft/s.
    """

    speed: Any
    alpha: Any
    beta: Any
    altitude: Any
    velocity: ca.SX
    rates: ca.SX
    down: ca.SX
    wind_to_body: ca.SX
    climb: Any
    pressure_head: Any
    mach: Any
    calibrated: Any
    air: Air


def motion_of(x: Any) -> Motion:
    """The motion of a state, whose fields are those of the model's states."""
    cos_alpha = ca.cos(x.alpha)
    sin_alpha = ca.sin(x.alpha)
    cos_beta = ca.cos(x.beta)
    sin_beta = ca.sin(x.beta)
    wind_to_body = ca.vertcat(
        ca.horzcat(cos_alpha * cos_beta, -cos_alpha * sin_beta, -sin_alpha),
        ca.horzcat(sin_beta, cos_beta, 0.0),
        ca.horzcat(sin_alpha * cos_beta, -sin_alpha * sin_beta, cos_alpha),
    )
    velocity = x.speed * wind_to_body[:, 0]
    down = ca.vertcat(
        -ca.sin(x.pitch), ca.sin(x.roll) * ca.cos(x.pitch), ca.cos(x.roll) * ca.cos(x.pitch)
    )
    air = air_at(x.altitude)
    mach = x.speed / air.sound
    return Motion(
        speed=x.speed,
        alpha=x.alpha,
        beta=x.beta,
        altitude=x.altitude,
        velocity=velocity,
        rates=ca.vertcat(x.roll_rate, x.pitch_rate, x.yaw_rate),
        down=down,
        wind_to_body=wind_to_body,
        climb=-ca.dot(down, velocity),
        pressure_head=0.5 * air.density * x.speed**2,
        mach=mach,
        calibrated=calibrated_speed(mach, air.pressure),
        air=air,
    )


def state_properties(x: Any, motion: Motion, metrics: Metrics, mass: Mass) -> dict[str, Any]:
    """Properties that a state sets, by name; still air, height above a ground at sea level."""
    u, v, w = ca.vertsplit(motion.velocity)
    air = motion.air
    total_temperature = air.temperature * (1.0 + 0.2 * motion.mach**2)
    viscosity = _VISCOSITY * air.temperature**1.5 / (_SUTHERLAND + air.temperature)
    ground_speed = ca.sqrt(ca.fmax(motion.speed**2 - motion.climb**2, 1e-12))
    turning = (x.pitch_rate * ca.sin(x.roll) + x.yaw_rate * ca.cos(x.roll)) / ca.cos(x.pitch)
    reference_height = x.altitude - ca.dot(motion.down, mass.arm(metrics.reference_point))
    equivalent = ca.sqrt(2.0 * motion.pressure_head / SEA_LEVEL.density)
    degrees = 180.0 / math.pi
    values = {
        "velocities/u-fps": u,
        "velocities/v-fps": v,
        "velocities/w-fps": w,
        "velocities/vt-fps": motion.speed,
        "velocities/vtrue-fps": motion.speed,
        "velocities/vtrue-kts": motion.speed / KNOT,
        "velocities/vc-fps": motion.calibrated,
        "velocities/vc-kts": motion.calibrated / KNOT,
        "velocities/ve-fps": equivalent,
        "velocities/ve-kts": equivalent / KNOT,
        "velocities/mach": motion.mach,
        "velocities/machU": u / air.sound,
        "velocities/vg-fps": ground_speed,
        "velocities/ned-velocity-mag-fps": motion.speed,
        "velocities/h-dot-fps": motion.climb,
        "velocities/v-down-fps": -motion.climb,
        "velocities/phidot-rad_sec": x.roll_rate + turning * ca.sin(x.pitch),
        "velocities/thetadot-rad_sec": x.pitch_rate * ca.cos(x.roll) - x.yaw_rate * ca.sin(x.roll),
        "velocities/psidot-rad_sec": turning,
        "aero/alpha-rad": x.alpha,
        "aero/alpha-deg": x.alpha * degrees,
        "aero/alpha-wing-rad": x.alpha + metrics.incidence,
        "aero/beta-rad": x.beta,
        "aero/beta-deg": x.beta * degrees,
        "aero/mag-beta-rad": ca.fabs(x.beta),
        "aero/mag-beta-deg": ca.fabs(x.beta) * degrees,
        "aero/qbar-psf": motion.pressure_head,
        "aero/qbarUW-psf": 0.5 * air.density * (u**2 + w**2),
        "aero/qbarUV-psf": 0.5 * air.density * (u**2 + v**2),
        "aero/qbar-area": motion.pressure_head * metrics.area,
        "aero/Re": motion.speed * metrics.chord * air.density / viscosity,
        "aero/bi2vel": metrics.span / (2.0 * motion.speed),
        "aero/ci2vel": metrics.chord / (2.0 * motion.speed),
        "aero/h_b-cg-ft": x.altitude / metrics.span,
        "aero/h_b-mac-ft": reference_height / metrics.span,
        "aero/stall-hyst-norm": 0.0,
        "flight-path/gamma-rad": ca.asin(motion.climb / motion.speed),
        "flight-path/gamma-deg": ca.asin(motion.climb / motion.speed) * degrees,
        "position/h-sl-ft": x.altitude,
        "position/h-agl-ft": x.altitude,
        "position/geod-alt-ft": x.altitude,
        "position/h-sl-meters": x.altitude * FT_TO_M,
        "position/h-agl-km": x.altitude * FT_TO_M / 1000.0,
        "propulsion/tat-r": total_temperature,
        "propulsion/tat-c": (total_temperature - 491.67) / 1.8,
        "propulsion/pt-lbs_sqft": pitot_pressure(motion.mach, air.pressure),
        "atmosphere/T-R": air.temperature,
        "atmosphere/P-psf": air.pressure,
        "atmosphere/rho-slugs_ft3": air.density,
        "atmosphere/a-fps": air.sound,
        "atmosphere/theta": air.temperature / SEA_LEVEL.temperature,
        "atmosphere/delta": air.pressure / SEA_LEVEL.pressure,
        "atmosphere/sigma": air.density / SEA_LEVEL.density,
        "atmosphere/a-ratio": air.sound / SEA_LEVEL.sound,
        "atmosphere/T-sl-R": SEA_LEVEL.temperature,
        "atmosphere/P-sl-psf": SEA_LEVEL.pressure,
        "atmosphere/rho-sl-slugs_ft3": SEA_LEVEL.density,
        "atmosphere/a-sl-fps": SEA_LEVEL.sound,
        "atmosphere/pressure-altitude": x.altitude,
        "atmosphere/density-altitude": x.altitude,
    }
    for letter, rate in zip("pqr", (x.roll_rate, x.pitch_rate, x.yaw_rate), strict=True):
        values |= {f"velocities/{letter}{kind}-rad_sec": rate for kind in ("", "-aero", "i")}
    for letter, speed in zip("uvw", (u, v, w), strict=True):
        values[f"velocities/{letter}-aero-fps"] = speed
    angles = {
        "phi": x.roll,
        "theta": x.pitch,
        "psi": x.yaw,
        "roll": x.roll,
        "pitch": x.pitch,
        "heading-true": x.yaw,
    }
    for name, angle in angles.items():
        values[f"attitude/{name}-rad"] = angle
        values[f"attitude/{name}-deg"] = angle * degrees
    return values | _fixed_properties(metrics, mass)


def _fixed_properties(metrics: Metrics, mass: Mass) -> dict[str, Any]:
    """Properties of size and mass."""
    chord_area = metrics.chord * metrics.area
    span_area = metrics.span * metrics.area
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
        "metrics/lh-norm": metrics.tail_arm / metrics.chord if metrics.chord else 0.0,
        "metrics/lv-norm": metrics.fin_arm / metrics.chord if metrics.chord else 0.0,
        "metrics/vbarh-norm": metrics.tail_arm * metrics.tail_area / chord_area
        if chord_area
        else 0.0,
        "metrics/vbarv-norm": metrics.fin_arm * metrics.fin_area / span_area if span_area else 0.0,
        "inertia/mass-slugs": mass.slugs,
        "inertia/weight-lbs": mass.weight,
        "inertia/empty-weight-lbs": mass.empty_weight,
        "inertia/ixx-slugs_ft2": mass.inertia[0, 0],
        "inertia/iyy-slugs_ft2": mass.inertia[1, 1],
        "inertia/izz-slugs_ft2": mass.inertia[2, 2],
        "inertia/ixy-slugs_ft2": -mass.inertia[0, 1],
        "inertia/ixz-slugs_ft2": mass.inertia[0, 2],
        "inertia/iyz-slugs_ft2": -mass.inertia[1, 2],
    }
    for axis, letter in enumerate("xyz"):
        values[f"inertia/cg-{letter}-in"] = mass.center[axis]
        values[f"metrics/aero-rp-{letter}-in"] = metrics.reference_point[axis]
        values[f"metrics/eyepoint-{letter}-in"] = metrics.eye_point[axis]
    return values
