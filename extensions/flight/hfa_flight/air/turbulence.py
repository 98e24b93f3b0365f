"""Turbulence of MIL-F-8785C with six components, given by level and altitude or by intensity.

Source: MIL-F-8785C, *Flying Qualities of Piloted Airplanes*, 1980, Section 3.7: Dryden and
von Karman spectra, spectra of the angular rates, scale lengths and intensities (Figure 7; at low
altitude Figures 10 and 11). MIL-STD-1797A defines the same spectra with L_v and L_w half as long.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa.options.argument_types import option_errors, positive
from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import (
    ADDED,
    gust_factors,
    in_gusts,
    kind_of_signal,
    missing_states,
    undeclared,
)
from hfa_flight.air.gusts import UPDRAFT, Gust, foot_in_length_unit, gust_speed, state_of
from hfa_support.errors import BadInputError, is_finite, shown
from hfa_support.matrices import of_step
from hfa_support.units import FOOT, KNOT, conversion_factor
from trim.point.operating_point import OperatingPoint

LEVELS = ("light", "moderate", "severe")
SPECTRA = ("dryden", "karman")
#: Forms of turbulence as text.
FORM = "LEVEL[:ALTITUDE[:SPAN]]"
FORM_OF_OWN = "own:SIGMA:SCALE[:SPAN]"
_KNOT = KNOT / FOOT
#: Wind 20 ft above the ground, ft/s, by level.
_WIND_AT_20_FT = dict(zip(LEVELS, (15.0 * _KNOT, 30.0 * _KNOT, 45.0 * _KNOT), strict=True))
#: Figure 7: altitudes, ft, and intensities, ft/s, with the exceedance probabilities 1e-2, 1e-3 and
#: 1e-5.
_ALTITUDES = (1750.0, 3750.0, 7500.0, 15e3, 25e3, 35e3, 45e3, 55e3, 65e3, 75e3, 80e3)
_INTENSITIES = {
    "light": (6.9, 7.4, 6.7, 4.6, 2.7, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
    "moderate": (9.6, 10.6, 10.1, 8.0, 6.6, 5.0, 4.2, 2.7, 0.0, 0.0, 0.0),
    "severe": (17.6, 23.0, 23.6, 22.1, 20.0, 16.0, 15.1, 12.1, 7.9, 6.2, 5.1),
}
#: Altitudes, ft: the lowest one, the upper end of low altitude and the lower end of high altitude.
_LOWEST = 10.0
_LOW = 1000.0
_HIGH = 2000.0
_LENGTH = {"dryden": 1750.0, "karman": 2500.0}


class Shape(NamedTuple):
    """Normalized transfer function Π (1 + z s) / Π (1 + p s).

    s is in units of V/L, with the airspeed V and the scale length L.

    zeros: time constants z, in units of L/V
    poles: time constants p, in units of L/V
    """

    zeros: tuple[float, ...]
    poles: tuple[float, ...]


#: Spectrum -> filters of u (along) and of v and w (across), with gain 1 at s = 0. The Dryden
#: filters are exact. The von Karman filters were fitted to the spectra up to ωL/V = 1000, by least
#: squares of high powers. There, the power is within 0.9 % (u) and 1.6 % (v, w). Beyond, it
#: decreases with ω^-2 instead of ω^-5/3.
FILTERS = {
    "dryden": (Shape((), (1.0,)), Shape((3.0**0.5,), (1.0, 1.0))),
    "karman": (
        Shape(
            (0.403033, 0.0728512, 0.0128230, 0.00214775),
            (1.2275648, 0.3052184, 0.0545644, 0.00958817, 0.00154290),
        ),
        Shape(
            (2.8717436, 0.1451688, 0.0200186, 0.00267668),
            (2.3627811, 0.7898489, 0.1043219, 0.0143836, 0.00186558),
        ),
    ),
}


@dataclass(frozen=True)
class Turbulence:
    """Turbulence with the spectra of MIL-F-8785C.

    level: light, moderate or severe, with the intensities and scales of the specification; or
      (intensity, scale) of u, v and w, in the model's units.
    altitude: altitude at which a level is evaluated, in the model's unit of length. Default: that
        of the trim.
    span: wing span, in the model's unit of length. Without a span, p, q and r are 0.
    spectrum: dryden or karman.

    Raises BadInputError if level or spectrum is unknown, a number is not positive, or both altitude
    and intensity are given.

    >>> import hfa
    >>> hfa.Turbulence("light", 500.0, span=36.0).level
    'light'
    """

    level: str | tuple[float, float]
    altitude: float | None = None
    span: float | None = None
    spectrum: str = "dryden"

    def __post_init__(self) -> None:
        """Raise BadInputError if level, spectrum or a number is wrong."""
        numbers = {"altitude": self.altitude, "span": self.span}
        if isinstance(self.level, tuple) and len(self.level) == 2:
            numbers["intensity"], numbers["scale"] = self.level
        elif not isinstance(self.level, str) or self.level not in LEVELS:
            raise BadInputError(
                f"the level of turbulence is {shown(self.level)}; give light, moderate, severe, or"
                " your own (intensity, scale)"
            )
        if self.spectrum not in SPECTRA:
            raise BadInputError(
                f"the spectrum of turbulence is {shown(self.spectrum)}; give {' or '.join(SPECTRA)}"
            )
        for name, value in numbers.items():
            if value is not None and not (is_finite(value) and value > 0.0):
                raise BadInputError(
                    f"the {name} of turbulence is {shown(value)}; give a positive number"
                )
        if "scale" in numbers and self.altitude is not None:
            raise BadInputError(
                "turbulence of your own intensity does not depend on altitude; remove the altitude"
            )

    @property
    def text(self) -> str:
        """Text from which `turbulence_of` makes the same turbulence, such as "moderate:40000.0"."""
        spectrum = "" if self.spectrum == SPECTRA[0] else f"{self.spectrum}-"
        if isinstance(self.level, str):
            values = [self.level, self.altitude, self.span]
        else:
            values = ["own", *self.level, self.span]
        words = ["" if value is None else str(value) for value in values]
        return (spectrum + ":".join(words)).rstrip(":")

    def air(self, point: OperatingPoint, interval: float, count: int, seed: int) -> TurbulentAir:
        """Return the turbulence of a flight that begins at the trim `point`.

        interval: duration of a sample, s
        count: number of samples
        seed: seed of the noise

        Raises BadInputError if the altitude is unknown, if the specification has no turbulence of
        this level there, if no speed is recognized, or if the model supports no component.
        """
        model = point.model
        speed_name = state_of(model, "speed")
        if not speed_name or conversion_factor("ft/s", model.unit(speed_name)) is None:
            raise BadInputError(
                f"{model.name} has no state or output in a unit of speed that is recognized as its "
                "speed, which turbulence requires; an aircraft in Python may declare a state or "
                "output speed in m/s"
            )
        feet = foot_in_length_unit(model)

        # Altitudes in ft. In the model they may be in another unit of length than the speed.
        altitude_name = state_of(model, "altitude")
        unit = model.unit(altitude_name) if altitude_name else ""
        foot_of_altitude = conversion_factor("ft", unit) or feet
        altitude = trimmed_at = None
        if altitude_name in model.states:
            trimmed_at = float(point.values[altitude_name]) / foot_of_altitude

        if isinstance(self.level, str):
            of_level = self._altitude_of_trim(point) if self.altitude is None else self.altitude
            altitude = of_level / foot_of_altitude
            scales = scales_and_intensities(self.level, altitude, self.spectrum)
        else:
            intensity, scale = self.level  # in the model's units
            scales = Scales((scale / feet,) * 3, (intensity / feet,) * 3)
        return TurbulentAir(
            self,
            *scales,  # lengths and intensities
            altitude=altitude,
            feet=feet,
            speed=gust_speed(point) / feet,
            interval=interval,
            count=count,
            seed=seed,
            taken=self._disturbances_of_components(point),
            trimmed_at=trimmed_at,
        )

    def _disturbances_of_components(self, point: OperatingPoint) -> dict[str, dict[str, float]]:
        """Return component -> disturbance of the model -> factor (`TurbulentAir.taken`)."""
        model = point.model
        moving = in_gusts(model)
        directions = gust_factors(moving, point.values)
        if self.span is None:
            directions = {name: directions[name] for name in directions if name in "uvw"}
        if not directions:
            needed = ", ".join(missing_states(model, "w"))
            if not needed:
                raise BadInputError(undeclared(model, UPDRAFT, "turbulence"))
            raise BadInputError(
                f"{model.name} has neither a gust input nor the states {needed} in rad, which "
                f"turbulence requires; declare these, or a disturbance {UPDRAFT}"
            )
        taken: dict[str, dict[str, float]] = {}
        # From a component to a disturbance: the direction, and the unit of the disturbance.
        for component, winds in directions.items():
            given = "ft/s" if component in "uvw" else "rad/s"
            for wind, direction in winds.items():
                unit = moving.disturbances[wind].unit
                size = conversion_factor(given, unit)
                if size is None:
                    raise BadInputError(
                        f"the disturbance {wind} of {model.name} is in {unit!r}, but turbulence "
                        f"is in {given}; declare a unit of this quantity"
                    )
                taken.setdefault(component, {})[wind] = direction * size
        return taken

    def _altitude_of_trim(self, point: OperatingPoint) -> float:
        """Return the altitude of the trim in the unit of the model.

        Raises BadInputError without an altitude, and for the default altitude of the model: the
        intensity depends on the altitude, so the user must choose it.
        """
        model = point.model
        give = f"give --turbulence {self.level}:ALTITUDE (in Python altitude=)"
        name = state_of(model, "altitude")
        if name not in model.states:
            raise BadInputError(
                f"{model.name} has no state altitude, which turbulence requires; {give}"
            )
        altitude = float(point.values[name])
        if altitude == model.trim.get(name):
            unit = model.unit(name)
            raise BadInputError(
                f"turbulence requires an explicit altitude, not the default of {altitude:g} "
                f"{unit}; {give}"
            )
        return altitude


def turbulence_of(text: str) -> Turbulence:
    """Return the turbulence of a text such as "moderate:40000".

    Raises BadInputError for another form than `FORM` and `FORM_OF_OWN`.
    """
    with option_errors("turbulence"):
        return typed_turbulence(text)


def typed_turbulence(text: str) -> Turbulence:
    """Return the turbulence of a text such as "karman-light:500" or "own:2:533:11".

    The text is [SPECTRUM-]LEVEL[:ALTITUDE[:SPAN]] or [SPECTRUM-]own:SIGMA:SCALE[:SPAN]. An ALTITUDE
    or SPAN may be empty. The message of a BadInputError follows the name of the option.
    """
    word, *typed = text.split(":")
    spectrum, _, level = word.rpartition("-")
    fewest, most = (2, 3) if level == "own" else (0, 2)  # numbers after the level
    is_known = level in (*LEVELS, "own") and spectrum in ("", *SPECTRA)
    if not is_known or not fewest <= len(typed) <= most:
        raise BadInputError(f"is {text!r}; give {FORM} with {', '.join(LEVELS)}, or {FORM_OF_OWN}")
    spectrum = spectrum or SPECTRA[0]
    if level == "own":
        intensity, scale, *spans = map(positive, typed)
        return Turbulence((intensity, scale), None, spans[0] if spans else None, spectrum)
    sizes = [positive(size) if size else None for size in typed]
    altitude, span = [*sizes, None, None][:2]
    return Turbulence(level, altitude, span, spectrum)


def level_text(turbulence: Turbulence) -> str:
    """Return text such as "moderate turbulence", or "turbulence" of an own intensity."""
    return f"{turbulence.level} turbulence" if isinstance(turbulence.level, str) else "turbulence"


class Scales(NamedTuple):
    """Scale lengths and intensities of turbulence.

    lengths: L_u, L_v, L_w, ft
    intensities: of u, v, w, ft/s
    """

    lengths: tuple[float, float, float]
    intensities: tuple[float, float, float]


def scales_and_intensities(level: str, altitude: float, spectrum: str) -> Scales:
    """Return scale lengths, ft, and intensities, ft/s, of u, v and w at an altitude in ft.

    Between 1000 and 2000 ft both are interpolated linearly. Raises BadInputError below 10 ft, above
    80,000 ft, and where Figure 7 defines no turbulence of this level.

    level: light, moderate or severe
    spectrum: dryden or karman
    """
    if not _LOWEST <= altitude <= _ALTITUDES[-1]:
        raise BadInputError(
            f"turbulence is requested at {altitude:g} ft, but MIL-F-8785C covers only 10 to "
            "80000 ft; give an altitude in this range"
        )
    high_length = _LENGTH[spectrum]
    high_intensity = float(np.interp(max(altitude, _HIGH), _ALTITUDES, _INTENSITIES[level]))
    if high_intensity == 0.0:
        raise BadInputError(
            f"MIL-F-8785C defines no {level} turbulence at {altitude:g} ft; give another level or"
            " altitude"
        )
    if altitude >= _HIGH:
        return Scales((high_length,) * 3, (high_intensity,) * 3)
    # The formulas up to 1000 ft, and the interpolation from there to 2000 ft.
    height = min(altitude, _LOW)
    ratio = 0.177 + 0.000823 * height  # (vertical / horizontal intensity)^2.5
    intensity_w = 0.1 * _WIND_AT_20_FT[level]
    intensity_uv = intensity_w / ratio**0.4
    length_uv = height / ratio**1.2
    # Rows: lengths and intensities of u, v and w.
    low = np.array([[length_uv, length_uv, height], [intensity_uv, intensity_uv, intensity_w]])
    high = np.array([[high_length], [high_intensity]])
    share_of_high = max(0.0, (altitude - _LOW) / (_HIGH - _LOW))
    lengths, intensities = (low + share_of_high * (high - low)).tolist()
    return Scales(tuple(lengths), tuple(intensities))


@dataclass(frozen=True)
class TurbulentAir(Gust):
    """Turbulence u, v, w, p, q, r of a flight, which begins in calm air.

    Filtered white noise, exact at the samples and linear between them. The filters begin at rest,
    because the aircraft begins at its trim in still air. p is independent noise through the filter

      σ_w sqrt(.8/V) (π/4b)^(1/6) L_w^(-1/3) / (1 + (4b/πV) s).

    q and r are the gradients of the frozen gust along the body, with the wing span b:

      q = w (s/V) / (1 + (4b/πV) s),  r = -v (s/V) / (1 + (3b/πV) s).

    turbulence: level or intensity, altitude, span and spectrum.
    lengths, intensities: as in `Scales`.
    altitude: altitude of the level, ft, or None for a given intensity.
    feet: length of a foot in the model's unit.
    speed: V, ft/s.
    interval: duration of a sample, s.
    count: number of samples.
    seed: seed of the noise.
    taken: component -> disturbance of the model -> factor, from ft/s or rad/s to its unit.
    trimmed_at: altitude of the trim, ft.
    """

    turbulence: Turbulence
    lengths: tuple[float, float, float]
    intensities: tuple[float, float, float]
    altitude: float | None
    feet: float
    speed: float
    interval: float
    count: int
    seed: int
    taken: Mapping[str, Mapping[str, float]]
    trimmed_at: float | None = None

    rises = True

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]  # computed
        """Names of the model's disturbances that the turbulence sets."""
        return tuple(dict.fromkeys(name for factors in self.taken.values() for name in factors))

    def held_inputs(self, sample: int) -> np.ndarray:
        """Return [time; values; slopes] of the disturbances at the start of a sample.

        The values are those of `values`, and the slopes their time derivatives during the sample.
        """
        now, later = self.values[sample : sample + 2]
        return np.array([self.interval * sample, *now, *((later - now) / self.interval)])

    def winds(self, t: Any, held: ca.SX) -> dict[str, Any]:
        """Return the turbulence at time t, as disturbance of the model -> value.

        held: [time; values; slopes] of `held_inputs`, as symbols
        """
        count = len(self.names)
        begin, values, slopes = ca.vertsplit(held, [0, 1, 1 + count, 1 + 2 * count])
        now = values + (t - begin) * slopes
        return dict(zip(self.names, ca.vertsplit(now), strict=True))

    @cached_property
    def values(self) -> np.ndarray:
        """Disturbances at the samples, (count + 1, k), in the units of the model."""
        components = AirFilter.of(self).drawn(self.count + 1, self.seed)
        return components @ self.factors

    @property
    def factors(self) -> np.ndarray:
        """Matrix (6, k) from the gust components to the k disturbances of the model.

        The components u, v, w, p, q and r are in ft/s and rad/s. The disturbances are in the units
        of the model.
        """
        matrix = np.zeros((len(ADDED), len(self.names)))
        for row, component in enumerate(ADDED):
            for wind, factor in self.taken.get(component, {}).items():
                matrix[row, self.names.index(wind)] = factor
        return matrix

    def text(self, model: Model) -> str:
        """Return one line on the turbulence: level, components, intensity and scale."""
        unit = "ft" if self.feet == 1.0 else "m"
        # of u, v and w, equal ones once
        intensity, scale = (
            " ".join(f"{value * self.feet:.4g}" for value in dict.fromkeys(values))
            for values in (self.intensities, self.lengths)
        )
        spectrum = {"dryden": "Dryden", "karman": "von Karman"}[self.turbulence.spectrum]
        which = f"turbulence of your own intensity ({spectrum})"
        if self.altitude is not None:
            altitude = f"{self.altitude * self.feet:,.0f} {unit}"
            which = f"{self.turbulence.level} turbulence of MIL-F-8785C ({spectrum}) at {altitude}"
            if self.trimmed_at is not None and abs(self.trimmed_at - self.altitude) > 1.0:
                which += f" (the trim is at {self.trimmed_at * self.feet:,.0f} {unit})"
        half = 0.5 * self.count * self.interval  # of the duration, s
        percent = f"{100 * AirFilter.of(self).risen(half):.0f} %"
        return (
            f"{which}: {', '.join(self.taken)}; intensity {intensity} {unit}/s, scale {scale} "
            f"{unit}. It begins in calm, and has {percent} of its intensity at {half:.4g} s; "
            "rms values are of the second half of a flight"
        )

    def left_out(self, model: Model) -> list[str]:
        """Return a sentence for each reason why components are omitted."""
        reasons: dict[str, list[str]] = {}
        for name in ADDED:
            if name in self.taken:
                continue
            reason = "no SPAN is given (--turbulence; b of hfa trim --full)"
            if missing_states(model, name):
                reason = "the equations have no such motion"
            elif kind := kind_of_signal(model, ADDED[name]):
                reason = f"{ADDED[name]} is one of the {kind}s of the model"
            reasons.setdefault(reason, []).append(name)
        return [f"turbulence without {', '.join(names)}: {why}" for why, names in reasons.items()]


@dataclass(frozen=True)
class AirFilter:
    """Filter x' = A x + B ν with the gust components (u, v, w, p, q, r) = C x.

    ν is white noise with a one-sided power spectral density of 1 per rad/s.

    A: (n, n)
    B: (n, 4), or (n, 3) without wing span
    C: (6, n)
    interval: duration of a sample, s
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    interval: float

    @classmethod
    def of(cls, air: TurbulentAir) -> AirFilter:
        """Return the filter that generates the turbulence `air`.

        Its equations of p, q and r are those of `TurbulentAir`.
        """
        from scipy.linalg import block_diag

        along, across = FILTERS[air.turbulence.spectrum]
        parts = []
        # 2 and 1 are the factors of L/π in the specified spectra of u, and of v and w.
        for shape, factor, length, intensity in zip(
            (along, across, across), (2.0, 1.0, 1.0), air.lengths, air.intensities, strict=True
        ):
            tau = length / air.speed
            parts.append(_cascade(shape, tau, intensity * np.sqrt(factor * tau / np.pi)))
        span = air.turbulence.span
        if span is not None:
            span = span / air.feet
            # p = roll_gain / (1 + s / pole), with pole = πV/4b
            roll_gain = air.intensities[2] * np.sqrt(0.8 / air.speed)
            roll_gain *= (np.pi / (4 * span)) ** (1 / 6)
            roll_gain /= air.lengths[2] ** (1 / 3)
            pole = np.array([[1 / (4 * span / (np.pi * air.speed))]])
            parts.append(_Filter(-pole, pole, np.array([[roll_gain]])))
        # in parallel, each with a noise of its own
        components = _Filter(*(block_diag(*blocks) for blocks in zip(*parts, strict=True)))
        if span is None:
            A, B, C = components
            return cls(A, B, np.vstack([C, np.zeros_like(C)]), air.interval)
        # q is the gradient of w in row 2, and r that of v in row 1.
        for row, sign, share in ((2, 1.0, 4.0), (1, -1.0, 3.0)):
            lag = share * span / (np.pi * air.speed)
            components = _with_gradient(components, row, lag, sign / (air.speed * lag))
        return cls(*components, air.interval)

    @cached_property
    def noise(self) -> np.ndarray:
        """Covariance π B B' that the noise adds to the states in a second, (n, n).

        White noise with a one-sided density of 1 per rad/s has the covariance π per second.
        """
        return np.asarray(np.pi * self.B @ self.B.T)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance P of the stationary states, (n, n): A P + P A' + π B B' = 0."""
        from scipy.linalg import solve_continuous_lyapunov

        return np.asarray(solve_continuous_lyapunov(self.A, -self.noise))

    @cached_property
    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Transition matrix Φ and noise gain G of a sample, x⁺ = Φ x + G ξ, ξ ~ N(0, I).

        G is the symmetric root of the correlations times the standard deviations: it is unique,
        whatever the units of the states and the eigenvectors of equal eigenvalues (of v and w).
        """
        Phi, covariance = of_step(self.A, self.noise, self.interval)
        deviations = np.sqrt(np.diag(covariance))
        deviations[deviations == 0.0] = 1.0  # of a state without noise
        correlations = covariance / np.outer(deviations, deviations)
        values, vectors = np.linalg.eigh(correlations)
        root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
        return Phi, deviations[:, None] * root

    def risen(self, time: float) -> float:
        """Return the smallest ratio of the intensity of u, v or w at a time to the stationary one.

        The filter is at rest at time 0.

        time: s
        """
        _, of_time = of_step(self.A, self.noise, time)
        linear = self.C[:3]
        shares = np.diag(linear @ of_time @ linear.T) / np.diag(linear @ self.covariance @ linear.T)
        return float(np.sqrt(shares.min()))

    def drawn(self, count: int, seed: int) -> np.ndarray:
        """Return random gust components at `count` samples, (count, 6).

        The filter begins at rest.
        """
        random = np.random.default_rng(seed)
        Phi, G = self.step
        x = np.zeros(len(Phi))
        noise = random.standard_normal((count, len(Phi))) @ G.T
        rows = np.empty((count, len(Phi)))
        for number in range(count):
            rows[number] = x
            x = Phi @ x + noise[number]
        return rows @ self.C.T


class _Filter(NamedTuple):
    """Filter x' = A x + B ν with the outputs C x, of white noise ν."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray


def _cascade(shape: Shape, tau: float, size: float) -> _Filter:
    """Return first-order filters in series, of which the first has no zero.

    Filter i with the input e has p x' = e - x and the output (z / p) e + (1 - z / p) x.

    tau: unit L/V of the time constants p and z, s
    size: factor on the output
    """
    poles = [pole * tau for pole in reversed(shape.poles)]
    zeros = [0.0, *(zero * tau for zero in reversed(shape.zeros))]
    n = len(poles)
    A = np.zeros((n, n))
    b = np.zeros((n, 1))
    of_states, of_noise = np.zeros(n), 1.0  # input of the next filter: of_states x + of_noise ν
    for row, (zero, pole) in enumerate(zip(zeros, poles, strict=True)):
        A[row] = of_states / pole
        A[row, row] = -1 / pole
        b[row] = of_noise / pole
        of_states = zero / pole * of_states
        of_states[row] = 1 - zero / pole
        of_noise *= zero / pole
    return _Filter(A, b, size * of_states[None])


def _with_gradient(given: _Filter, row: int, lag: float, gain: float) -> _Filter:
    """Return a filter with the further output gain (y - x), where lag x' = y - x.

    row: row of the output y of the given filter
    """
    n, noises = given.B.shape
    A = np.block([[given.A, np.zeros((n, 1))], [given.C[[row]] / lag, np.array([[-1 / lag]])]])
    B = np.vstack([given.B, np.zeros((1, noises))])
    C = np.hstack([given.C, np.zeros((len(given.C), 1))])
    gradient = gain * C[row]
    gradient[-1] = -gain  # of x, the last state
    return _Filter(A, B, np.vstack([C, gradient]))
