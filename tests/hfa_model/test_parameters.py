"""Parameters files: a written file is read back bit for bit, and every wrong file is refused in one line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import refusal

from hfa_model import Parameters, default_parameters, load_parameters, save_parameters
from hfa_model.parameters import FIELDS, ParameterSet
from hfa_support import BadInputError


@pytest.fixture
def saved(tmp_path: Path, parameter_set: ParameterSet) -> Path:
    path = tmp_path / "aircraft.toml"
    save_parameters(parameter_set, path, "A header.\nIts second line.")
    return path


def edited(path: Path, pattern: str, replacement: str) -> Path:
    """The file with exactly one place changed."""
    text, count = re.subn(pattern, replacement, path.read_text(encoding="utf-8"), count=1, flags=re.M)
    assert count == 1, f"{pattern!r} is not in the file"
    path.write_text(text, encoding="utf-8")
    return path


def assert_same(one: ParameterSet, other: ParameterSet) -> None:
    assert one.values == other.values
    assert (one.sources, one.notes) == (other.sources, other.notes)
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_round_trip_is_bit_for_bit(saved: Path, parameter_set: ParameterSet) -> None:
    assert parameter_set.covariance.shape == (15, 15)
    assert_same(load_parameters(saved), parameter_set)


def test_round_trip_of_awkward_numbers(tmp_path: Path, parameter_set: ParameterSet) -> None:
    rng = np.random.default_rng(1)
    awkward = Parameters(*(10.0 ** rng.uniform(-300, 300, len(FIELDS))).tolist())
    count = len(parameter_set.identified)
    sizes = 10.0 ** rng.uniform(-150, 150, count)
    covariance = np.outer(sizes, sizes) * np.where(np.eye(count), 1.0, 1 / 3)
    changed = replace(parameter_set, values=awkward, covariance=covariance)
    path = tmp_path / "awkward.toml"
    save_parameters(changed, path, "")
    assert_same(load_parameters(path), changed)


@pytest.mark.parametrize("units", [1.0, 1e100])
def test_a_covariance_with_a_negative_eigenvalue_is_refused(
    tmp_path: Path, parameter_set: ParameterSet, units: float
) -> None:
    """Symmetric, variances on the diagonal, but two parameters that vary together by more than they vary."""
    covariance = np.eye(len(parameter_set.identified)) * 1e-6
    covariance[0, 1] = covariance[1, 0] = 2e-6
    covariance[2] *= units
    covariance[:, 2] *= units
    path = tmp_path / "indefinite.toml"
    save_parameters(replace(parameter_set, covariance=covariance), path, "")
    assert "[covariance] is no covariance" in refusal(load_parameters, path)


def test_parameters_that_vary_as_one_are_accepted(tmp_path: Path, parameter_set: ParameterSet) -> None:
    """A covariance of rank one: its other eigenvalues are zero but for rounding."""
    direction = np.random.default_rng(2).normal(size=len(parameter_set.identified))
    path = tmp_path / "singular.toml"
    save_parameters(replace(parameter_set, covariance=np.outer(direction, direction)), path, "")
    np.testing.assert_array_equal(load_parameters(path).covariance, np.outer(direction, direction))


def test_covariance_gives_the_standard_errors(parameter_set: ParameterSet) -> None:
    errors = parameter_set.standard_errors
    assert tuple(errors) == parameter_set.identified
    assert errors["panel_mass"] ** 2 == pytest.approx(parameter_set.covariance[0, 0], rel=1e-15)
    assert all(0.0 < error < 0.01 * abs(getattr(parameter_set.values, name)) for name, error in errors.items())


@pytest.mark.parametrize(
    ("pattern", "replacement", "named"),
    [
        *(
            (r"(?<=^\[chord\]\n)value = .*", f"value = {value}", "chord.value is ")
            for value in ("-1.0", "0.0", "nan", '"8.0"', f"1{'0' * 400}")
        ),
        (r"^\[chord\]$", "[chrod]", "chrod"),
        (r"^\[chord\]\n(.+\n)+", "", "chord"),
        (r"(?<=^\[chord\]\n)value = .*\n", "", "chord"),
        (r"(?<=^\[chord\]\n)(value.*\nunit = ).*", r'\g<1>"m"', "chord"),
        (r"(?<=^\[chord\]\n)(value.*\nunit.*\nsource = ).*", r'\g<1>"guessed"', "chord"),
        (r"\Z", "\n[rudder]\nvalue = 1.0\n", "rudder"),
        (r"(?<=^names = \[)\"panel_mass\"", '"chord"', "covariance"),
        (r"^rows = \[\n.*\n", "rows = [\n", "covariance"),
        (r"(?<=^rows = \[\n)  \[[^,]*", "  [nan", "covariance"),
        (r"(?<=^rows = \[\n)  \[[^,]*", "  [-1.0", "covariance"),
        (r"(?<=^rows = \[\n)(  \[[^,]*, )[^,]*", r"\g<1>1.0", "covariance"),
        (r"(?<=^rows = \[\n)  \[[^,]*", '  ["a"', "covariance"),
        (r"^\[covariance\]\n(.*\n)*", "[covariance]\nnames = 3\n", "covariance"),
    ],
)
def test_wrong_entries_are_refused(saved: Path, pattern: str, replacement: str, named: str) -> None:
    assert named in refusal(load_parameters, edited(saved, pattern, replacement))


def test_the_named_sets_are_there() -> None:
    identified, released = (load_parameters(name).values for name in ("identified", "gibson-2011-simulation"))
    assert identified == default_parameters().values
    # The identification found the released values, each within three of its standard errors.
    errors = default_parameters().standard_errors
    off = {name: abs(getattr(identified, name) - getattr(released, name)) / error for name, error in errors.items()}
    assert max(off.values()) < 3.0, off
    with pytest.raises(
        BadInputError,
        match="gibson: no parameters of that name and no readable file; the names are identified, gibson-",
    ):
        load_parameters("gibson")
