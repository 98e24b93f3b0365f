"""Configuration of Section 5: section5.toml, initial condition and signals of the flights."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hfa_aircraft.waveform import Harmonic
from hfa_flight import Waveform
from hfa_support.files import read_toml
from hfa_support.reporting.data_files import jsonable

SECTIONS = ("5.1", "5.2", "5.3", "5.4")
_NONE = np.zeros(6)


class PaperFlight:
    """Initial condition and signals of the flights in Section 5 of the paper.

    All values are deviations from the trim in ft/s, rad and rad/s, in the order of
    `hfa_model.LINEAR_STATES`.

    INITIAL: initial condition x(0) of Section 5.1
    REFERENCE: command x_d with speed 7 + 0.01 t + 2 sin(0.5 t) ft/s, alpha 0.1 rad and dihedral
      angle 0.5 rad
    DISTURBANCE: disturbance d, 1.1 times the printed amplitudes
    NOISE: measurement noise of Section 5.4

    The paper prints no signs. Positive signs are assumed. They agree with the printed derivative
    0.01 + cos(0.5 t) of the speed command.
    """

    INITIAL = np.array([5.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    REFERENCE = Waveform(
        np.array([7.0, 0.1, 0.0, 0.0, 0.5, 0.0]),
        np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0]),
        (Harmonic(0.5, np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]), _NONE),),
    )
    _SINES = np.array([0.11, 0.22, 0.0, 0.11, 0.0, 0.11])
    _COSINES = np.array([0.0, 0.0, 0.22, 0.0, 0.11, 0.0])
    DISTURBANCE = Waveform(_NONE, _NONE, (Harmonic(0.1, _SINES, _COSINES),))
    _SLOW = Harmonic(
        0.1, np.array([0.0, 0.0, 0.005, 0.0, 0.005, 0.0]), np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0])
    )
    _FAST = Harmonic(
        0.5,
        np.array([0.0, 0.005, 0.0, 0.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 0.0, 0.005, 0.0, 0.005]),
    )
    NOISE = Waveform(_NONE, _NONE, (_SLOW, _FAST))


class Configuration(SimpleNamespace):
    """The tables of section5.toml as attributes, with the initial condition and the signals.

    initial: x(0), (6,)
    reference, disturbance, noise: signals as `Waveform`
    """

    def steps_per_tick(self) -> int:
        """Return the number of integration steps in a tick."""
        return round(self.flight.tick / self.flight.step)

    def predefined_time(self, section: str) -> float:
        """Return the predefined time T_w that the paper uses in a section, s."""
        return float(self.learning.predefined_time[SECTIONS.index(section)])

    def frozen(self, section: str) -> bool:
        """Return whether the learning in a section stops at T_w."""
        return bool(self.learning.frozen_at_predefined_time[SECTIONS.index(section)])

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as plain values for JSON."""
        tables = {
            name: vars(value)
            for name, value in vars(self).items()
            if isinstance(value, SimpleNamespace)
        }
        signals = {
            name: _signal_table(value)
            for name, value in vars(self).items()
            if isinstance(value, Waveform)
        }
        plain: dict[str, Any] = jsonable(
            {"initial_state": {"value": self.initial}, **tables, **signals}
        )
        return plain


def section5_configuration(changes: Mapping[str, Any] | None = None) -> Configuration:
    """Return the configuration used by this project.

    changes: name of a table -> changed entries, or name of the initial condition or a signal ->
      value
    """
    given = dict(changes or {})
    tables = read_toml(str(Path(__file__).with_name("section5.toml")))
    flown = {
        "initial": PaperFlight.INITIAL,
        "reference": PaperFlight.REFERENCE,
        "disturbance": PaperFlight.DISTURBANCE,
        "noise": PaperFlight.NOISE,
    }
    found: dict[str, Any] = {name: given.pop(name, value) for name, value in flown.items()}
    for name, table in tables.items():
        found[name] = SimpleNamespace(
            **{key: value for key, value in table.items() if key != "why"}
        )
        vars(found[name]).update(given.pop(name, {}))
    assert not given, f"no tables of the configuration: {given}"
    return Configuration(**found)


def _signal_table(signal: Waveform) -> dict[str, Any]:
    frequencies, sine, cosine = zip(*signal.harmonics, strict=True)
    waves = {"frequencies": frequencies, "sine": sine, "cosine": cosine}
    return {"constant": signal.constant, "slope": signal.slope, **waves}
