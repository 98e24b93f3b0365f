"""The configuration of Section 5: what the paper prints, and what hangs on the signs that it lost."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from experiment_configurations import COARSE, NOTHING, Changes, changed

from hfa_support import BadInputError
from studies.section5.configuration import SECTIONS, SignalSettings, section5_configuration
from studies.section5.experiment_flights import FlightPlan, simulate_plan
from studies.section5.flown_laws import EXACT
from studies.section5.setting import make_setting

DOCUMENT = Path(__file__).parents[3] / "docs" / "experiments.md"
SINE, COSINE = (0.11, 0.22, 0.0, 0.11, 0.0, 0.11), (0.0, 0.0, 0.22, 0.0, 0.11, 0.0)


def test_the_configuration_says_what_the_paper_prints() -> None:
    configuration = section5_configuration()
    t = 3.0
    d = (
        1.1
        * np.array([0.1, 0.2, 0.2, 0.1, 0.1, 0.1])
        * [np.sin(0.3), np.sin(0.3), np.cos(0.3), np.sin(0.3), np.cos(0.3), np.sin(0.3)]
    )
    n = [0.02 * np.cos(0.3), *(0.005 * np.array([np.sin(1.5), np.sin(0.3), np.cos(1.5), np.sin(0.3), np.cos(1.5)]))]
    np.testing.assert_allclose(configuration.disturbance.signal.at(t), d, rtol=1e-12)
    np.testing.assert_allclose(configuration.noise.signal.at(t), n, rtol=1e-12)
    np.testing.assert_allclose(
        configuration.reference.signal.at(t), [7.03 + 2.0 * np.sin(1.5), 0.1, 0.0, 0.0, 0.5, 0.0], rtol=1e-12
    )


def test_every_table_says_why() -> None:
    text = files("studies.section5").joinpath("section5.toml").read_text(encoding="utf-8")
    assert all(table["why"].strip() for table in tomllib.loads(text).values())


def test_every_window_that_something_is_measured_in_holds_samples() -> None:
    configuration = section5_configuration()
    flight, criteria = configuration.flight, configuration.criteria
    assert flight.ticks * flight.steps_per_tick * flight.step == pytest.approx(flight.duration, rel=1e-12)
    for section in SECTIONS:
        assert 10 * flight.tick <= configuration.predefined_time(section) <= flight.duration - flight.tick
    assert criteria.late[0] + flight.tick <= criteria.late[1] <= flight.duration
    assert criteria.short_adjustment <= flight.duration - flight.tick


def test_unknown_matrices_are_refused() -> None:
    with pytest.raises(BadInputError, match=r"guessed.*regenerated, printed"):
        make_setting(section5_configuration(), "guessed")


def test_another_configuration_is_another_setting() -> None:
    own = make_setting(section5_configuration())
    assert make_setting(changed({"critic": {"theta": 0.8}})).identity != own.identity
    assert make_setting(section5_configuration(), "printed").identity != own.identity


@pytest.mark.parametrize(
    ("said", "changes"),
    [
        ("{} without the disturbance", {"disturbance": {"sine": (NOTHING,), "cosine": (NOTHING,)}}),
        (
            "{} with its sign turned",
            {"disturbance": {"sine": (tuple(-x for x in SINE),), "cosine": (tuple(-x for x in COSINE),)}},
        ),
        (
            "{} with that of the angle's command turned",
            {"reference": {"constant": (7.0, -0.1, 0.0, 0.0, 0.5, 0.0)}},
        ),
        ("{} with that of the dihedral's", {"reference": {"constant": (7.0, 0.1, 0.0, 0.0, -0.5, 0.0)}}),
    ],
)
def test_the_error_of_alpha_with_other_signs_is_the_one_of_the_document(said: str, changes: Changes) -> None:
    """The angle of attack misses its command whatever the lost signs are, and docs/experiments.md says by how much."""
    assert section5_configuration().disturbance.sine == (SINE,)
    assert section5_configuration().disturbance.cosine == (COSINE,)
    setting = make_setting(changed(COARSE, changes))
    error = simulate_plan(setting, FlightPlan(5.0, EXACT), "5.1").metrics.relative_error["alpha"]
    assert error > 10.0 * setting.configuration.criteria.close
    assert said.format(f"{error:.3g}") in " ".join(DOCUMENT.read_text(encoding="utf-8").split())


def test_a_signal_has_as_many_amplitudes_as_frequencies() -> None:
    zero = (0.0,) * 6
    with pytest.raises(ValueError, match="zip"):
        SignalSettings(zero, zero, (1.0, 2.0), (zero,), (zero,)).signal  # noqa: B018
