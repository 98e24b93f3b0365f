"""How Section 5 is read: the file that comes with the project, and what another one must be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from experiment_readings import SHORT, changed, reading_file, text_of_reading

from hfa_model.support.errors import BadInputError
from verification.experiments.configuration import default_reading, load_reading
from verification.experiments.experiment_flights import FlightPlan, fly
from verification.experiments.flown_laws import HELPED
from verification.experiments.setting import make_setting


def test_the_reading_says_what_the_paper_prints() -> None:
    reading = default_reading()
    t = 3.0
    d = (
        1.1
        * np.array([0.1, 0.2, 0.2, 0.1, 0.1, 0.1])
        * [np.sin(0.3), np.sin(0.3), np.cos(0.3), np.sin(0.3), np.cos(0.3), np.sin(0.3)]
    )
    n = [0.02 * np.cos(0.3), *(0.005 * np.array([np.sin(1.5), np.sin(0.3), np.cos(1.5), np.sin(0.3), np.cos(1.5)]))]
    np.testing.assert_allclose(reading.signal("disturbance").at(t), d, rtol=1e-12)
    np.testing.assert_allclose(reading.signal("noise").at(t), n, rtol=1e-12)
    np.testing.assert_allclose(
        reading.signal("reference").at(t), [7.03 + 2.0 * np.sin(1.5), 0.1, 0.0, 0.0, 0.5, 0.0], rtol=1e-12
    )
    assert all(table["why"].strip() for table in reading.tables.values())


@pytest.mark.parametrize(
    ("line", "planted", "complaint"),
    [
        ("step = 1e-4", "", "flight.step is missing"),
        ("step = 1e-4", "step = 1e-4\nspeed = 3", "flight.speed is unknown"),
        ("step = 1e-4", "step = nan", "flight.step holds nan"),
        ("step = 1e-4", "step = -1e-4", "must be positive"),
        ("step = 1e-4", "step = 3e-4", "whole number of steps"),
        ("step = 1e-4", 'step = "small"', "must be a finite number"),
        ("step = 1e-4", "step = true", "must be a finite number"),
        ("step = 1e-4", "step = ", "is not TOML"),
        ("value = [5.0, 0.05, 0.0, 0.0, 0.0, 0.0]", "value = [5.0]", "a list of 6"),
        ("value = [5.0, 0.05, 0.0, 0.0, 0.0, 0.0]", "value = [5.0, inf, 0.0, 0.0, 0.0, 0.0]", "holds inf"),
        ("frequencies = [0.5]", "frequencies = [0.5, 0.6]", "different lengths"),
        ("frequencies = [0.5]", "frequencies = [-0.5]", "not positive"),
        ("frequencies = [0.5]", "frequencies = []", "not empty"),
        ('normalisation = "root"', 'normalisation = "cube"', "choose from root, squared"),
        ("disturbance_measured = true", "disturbance_measured = 1", "true or false"),
        ("samples = 50", "samples = 50.5", "whole number"),
        ("alpha1 = 100.0", "alpha1 = -1.0", "must not be negative"),
        ("late = [10.0, 20.0]", "late = [10.0, 21.0]", "within the flight"),
        ("late = [10.0, 20.0]", "late = [20.0, 10.0]", "at least a tick"),
        ("late = [10.0, 20.0]", "late = [0.5001, 0.5002]", "at least a tick"),
        ("duration = 20.0", "duration = 5.0", "predefined_time of 5.1 is 10 s; it must lie between 10 ticks"),
        ("duration = 20.0", "duration = 10.0", "less one tick"),
        ("predefined_time = [10.0, 5.0, 5.0, 5.0]", "predefined_time = [0.01, 5.0, 5.0, 5.0]", "of 5.1 is 0.01 s"),
        ("predefined_time = [10.0, 5.0, 5.0, 5.0]", "predefined_time = [10.0, 5.0, 5.0, 0.05]", "of 5.4 is 0.05 s"),
        ("short_adjustment = 5.0", "short_adjustment = 20.0", "short_adjustment is 20 s"),
        ("[noise]", "[din]", "noise is missing"),
        ("[flight]", "flight = 3\n[other]", "flight is 3"),
    ],
)
def test_a_bad_reading_is_refused(tmp_path: Path, line: str, planted: str, complaint: str) -> None:
    text = text_of_reading()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(f"\n{line}\n", f"\n{planted}\n", 1), encoding="utf-8")
    assert path.read_text(encoding="utf-8") != text
    with pytest.raises(BadInputError, match=complaint) as raised:
        load_reading(path)
    assert "mine.toml" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_brief_flight_must_have_a_brief_adjustment(tmp_path: Path) -> None:
    """An adjustment that outlasts the flight leaves nothing to compare with."""
    brief = {
        "duration = 20.0": "duration = 4.0",
        "late = [10.0, 20.0]": "late = [2.0, 4.0]",
        "predefined_time = [10.0, 5.0, 5.0, 5.0]": "predefined_time = [2.0, 1.0, 1.0, 1.0]",
    }
    with pytest.raises(BadInputError, match="short_adjustment is 5 s; it must end a tick or more before"):
        load_reading(reading_file(tmp_path, brief))
    load_reading(reading_file(tmp_path, brief | {"short_adjustment = 5.0": "short_adjustment = 2.0"}))


@pytest.mark.parametrize(
    ("learning_time", "late", "adjustment"), [(0.1, (0.0, 0.01), 0.001), (0.99, (0.99, 1.0), 0.99)]
)
def test_the_narrowest_reading_accepted_has_all_its_numbers(
    tmp_path: Path, learning_time: float, late: tuple[float, float], adjustment: float
) -> None:
    """What the rules let through is measured: no window is empty."""
    changes = SHORT | {
        "predefined_time = [10.0, 5.0, 5.0, 5.0]": f"predefined_time = {[learning_time] * 4}",
        "late = [10.0, 20.0]": f"late = {list(late)}",
        "short_adjustment = 5.0": f"short_adjustment = {adjustment}",
    }
    setting = make_setting(load_reading(reading_file(tmp_path, changes)))
    record = fly(setting, FlightPlan(5.0, HELPED), "5.1")
    assert record.held
    numbers = [record.metrics["learning"][name] for name in ("late_update", "end_update", "path_share")]
    numbers += [*record.metrics["rms_error"].values(), *record.metrics["growth"].values()]
    assert np.isfinite(numbers).all()


def test_a_reading_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="cannot be read"):
        load_reading(tmp_path / "none.toml")


def test_unknown_matrices_are_refused() -> None:
    with pytest.raises(BadInputError, match=r"guessed.*regenerated, printed"):
        make_setting(default_reading(), "guessed")


def test_another_reading_is_another_setting(tmp_path: Path) -> None:
    other = changed(text_of_reading(), {"theta = 0.9": "theta = 0.8"})
    path = tmp_path / "other.toml"
    path.write_text(other, encoding="utf-8")
    assert make_setting(load_reading(path)).identity != make_setting(default_reading()).identity
    assert make_setting(default_reading(), "printed").identity != make_setting(default_reading()).identity
