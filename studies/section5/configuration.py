"""The configuration of Section 5: section5.toml, and the start and signals that `hfa fly` calls `paper` too."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from controller import Signal
from controller.policy.signals import PaperFlight
from hfa_support.files import read_toml
from hfa_support.jsonable import jsonable

SECTIONS = ("5.1", "5.2", "5.3", "5.4")


class Configuration(SimpleNamespace):
    """The tables of section5.toml as attributes; initial: x(0); the signals reference, disturbance and noise."""

    def steps_per_tick(self) -> int:
        """Steps of the integration in a tick."""
        return round(self.flight.tick / self.flight.step)

    def predefined_time(self, section: str) -> float:
        """T_w of a section, s."""
        return float(self.learning.predefined_time[SECTIONS.index(section)])

    def frozen(self, section: str) -> bool:
        """Whether a section stops learning at T_w."""
        return bool(self.learning.frozen_at_predefined_time[SECTIONS.index(section)])

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, table by table, without the reasons."""
        tables = {name: vars(value) for name, value in vars(self).items() if isinstance(value, SimpleNamespace)}
        signals = {name: _signal_table(value) for name, value in vars(self).items() if isinstance(value, Signal)}
        plain: dict[str, Any] = jsonable({"initial_state": {"value": self.initial}, **tables, **signals})
        return plain


def section5_configuration(changes: Mapping[str, Any] | None = None) -> Configuration:
    """The configuration of this project. changes: table -> entries that replace its own, or initial and signals."""
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
        found[name] = SimpleNamespace(**{key: value for key, value in table.items() if key != "why"})
        vars(found[name]).update(given.pop(name, {}))
    assert not given, f"no tables of the configuration: {given}"
    return Configuration(**found)


def _signal_table(signal: Signal) -> dict[str, Any]:
    frequencies, sine, cosine = zip(*signal.harmonics, strict=True)
    waves = {"frequencies": frequencies, "sine": sine, "cosine": cosine}
    return {"constant": signal.constant, "slope": signal.slope, **waves}
