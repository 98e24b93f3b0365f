"""The configuration of Section 5: the signs and settings that the paper leaves open, from section5.toml."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from controller.policy.signals import Harmonic, Signal
from hfa_support.jsonable import jsonable

SECTIONS = ("5.1", "5.2", "5.3", "5.4")


@dataclass(frozen=True)
class FlightSettings:
    """step, duration and tick, s. lost_beyond: ft/s, rad and rad/s; a flight that passes it is lost."""

    step: float
    duration: float
    tick: float
    lost_beyond: float

    @property
    def steps_per_tick(self) -> int:
        """Steps of the integration in a tick."""
        return round(self.tick / self.step)

    @property
    def ticks(self) -> int:
        """Ticks of a whole flight."""
        return round(self.duration / self.tick)


@dataclass(frozen=True)
class InitialState:
    """value: x(0), (6,)."""

    value: tuple[float, ...]


@dataclass(frozen=True)
class SignalSettings:
    """constant + slope t + Σ_k sine_k sin(f_k t) + cosine_k cos(f_k t).

    constant, slope: (6,). frequencies: (K,), rad/s. sine, cosine: (K, 6).
    """

    constant: tuple[float, ...]
    slope: tuple[float, ...]
    frequencies: tuple[float, ...]
    sine: tuple[tuple[float, ...], ...]
    cosine: tuple[tuple[float, ...], ...]

    @property
    def signal(self) -> Signal:
        """The signal, (6,)."""
        rows = zip(self.frequencies, self.sine, self.cosine, strict=True)
        harmonics = tuple(Harmonic(f, np.array(sine), np.array(cosine)) for f, sine, cosine in rows)
        return Signal(np.array(self.constant), np.array(self.slope), harmonics)


@dataclass(frozen=True)
class LearningTimes:
    """One entry for each of `SECTIONS`: T_w, s, and whether learning stops there."""

    predefined_time: tuple[float, ...]
    frozen_at_predefined_time: tuple[bool, ...]


@dataclass(frozen=True)
class CriticSettings:
    """What all critics share. box: (6,), half-widths of the random states; pool: how many; samples: N_h of them."""

    basis: str
    theta: float
    samples: int
    pool: int
    box: tuple[float, ...]
    seed: int
    normalisation: str


@dataclass(frozen=True)
class PrintedLaw:
    """Eq. (46) as printed. drift: whether that of the current sample carries the reference."""

    initial_weight: float
    coordinates: str
    drift: str


@dataclass(frozen=True)
class ModifiedLaw:
    """Eq. (46) as it stays bounded. start_Q: W(0) and the stored policies are the LQR of Q = start_Q I."""

    basis: str
    alpha1: float
    alpha2: float
    start_Q: float
    coordinates: str
    drift: str


@dataclass(frozen=True)
class IntegralBaseline:
    """Integral RL, the baseline of Section 5.2; see `IrlSettings`."""

    form: str
    disturbance_measured: bool
    interval: float
    intervals: int
    iterations: int
    probe: float
    disturbance: float


@dataclass(frozen=True)
class PlantMismatch:
    """factors: ΔA = factor A, one flight each."""

    factors: tuple[float, ...]


@dataclass(frozen=True)
class Reweighting:
    """alpha_factor: by which Q of the angle of attack is multiplied."""

    alpha_factor: float


@dataclass(frozen=True)
class Criteria:
    """Numbers for the paper's words; each is explained in section5.toml. late: the window from .. to, s."""

    late: tuple[float, float]
    short_adjustment: float
    close: float
    bounded: float
    smooth: float
    concentrated: float
    fallen: float
    orders: float
    steady: float
    alike: float
    degraded: float
    faster: float


@dataclass(frozen=True)
class Configuration:
    """The tables of section5.toml by name. reference: x_d, disturbance: d, noise: n."""

    flight: FlightSettings
    initial_state: InitialState
    reference: SignalSettings
    disturbance: SignalSettings
    noise: SignalSettings
    learning: LearningTimes
    critic: CriticSettings
    published_as_printed: PrintedLaw
    published_modified: ModifiedLaw
    irl: IntegralBaseline
    uncertainty: PlantMismatch
    reweighted: Reweighting
    criteria: Criteria

    @property
    def initial(self) -> np.ndarray:
        """x(0), (6,)."""
        return np.array(self.initial_state.value)

    def predefined_time(self, section: str) -> float:
        """T_w of an experiment, s."""
        return self.learning.predefined_time[SECTIONS.index(section)]

    def frozen(self, section: str) -> bool:
        """Whether an experiment stops learning at T_w."""
        return self.learning.frozen_at_predefined_time[SECTIONS.index(section)]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, table by table."""
        plain: dict[str, Any] = jsonable(asdict(self))
        return plain


@cache
def section5_configuration() -> Configuration:
    """The configuration in section5.toml, without its reasons."""
    text = Path(__file__).with_name("section5.toml").read_text(encoding="utf-8")
    tables, kinds = tomllib.loads(text), get_type_hints(Configuration)
    return Configuration(
        **{field.name: _table(kinds[field.name], tables[field.name]) for field in fields(Configuration)}
    )


def _table(kind: Any, table: dict[str, Any]) -> Any:
    return kind(**{name: _frozen(value) for name, value in table.items() if name != "why"})


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value
