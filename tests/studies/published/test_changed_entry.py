"""Search for misprints in plants."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from printed_samples import SLIPS, printed_sample

from hfa import NoSolutionError
from studies.published.verdict import check_printed

SLOW = pytest.mark.slow
ANOTHER_PLANT = "the answer belongs to another plant"


@pytest.fixture
def classify(tmp_path) -> Callable[[str], tuple[str, str]]:
    """Return a function from the text of a file to the class of the answer and the reason.

    For a plant without an answer, the function returns "no solution" and the error.
    """

    def classify_text(text: str) -> tuple[str, str]:
        path = tmp_path / "printed.toml"
        path.write_text(text)
        try:
            classified = check_printed(path).classified
        except NoSolutionError as error:
            return "no solution", str(error)
        return classified.name, classified.reason

    return classify_text


@pytest.mark.parametrize("count", [6, pytest.param(200, marks=SLOW)])
def test_most_planted_misprints_are_named(classify, count) -> None:
    """At least 85 % of the visible planted misprints are named, and no correct entry is."""
    rng = np.random.default_rng(1)
    visible = 0
    named = 0
    for index in range(count):
        sample, slip = printed_sample(index, rng).with_slip(SLIPS[index % len(SLIPS)], rng)
        name, reason = classify(sample.file())
        if name == ANOTHER_PLANT:
            assert reason.startswith(f"{slip.entry} = "), (slip, reason)
        visible += name != "as printed"
        named += name == ANOTHER_PLANT or f"with {slip.entry} = {slip.right}, not" in reason
    assert visible > 0.5 * count
    assert named >= 0.85 * visible


@pytest.mark.parametrize("count", [8, pytest.param(200, marks=SLOW)])
def test_correct_answers_are_as_printed(classify, count) -> None:
    """Correctly printed answers have the class `as printed`."""
    rng = np.random.default_rng(2)
    for index in range(count):
        assert classify(printed_sample(index, rng).file())[0] == "as printed"


@pytest.mark.parametrize("count", [2, pytest.param(100, marks=SLOW)])
def test_learned_answers_name_no_entry(classify, count) -> None:
    """For learned answers with random errors, no entry of the plant is named as misprinted."""
    rng = np.random.default_rng(3)
    for index in range(count):
        sample = printed_sample(index, rng).noisy(10.0 ** rng.uniform(-4.0, -1.5), rng)
        name, reason = classify(sample.file(learned=True))
        assert name != ANOTHER_PLANT
        assert "which:" not in reason


@pytest.mark.slow
def test_two_misprints_name_no_third_entry(classify) -> None:
    """With two planted misprints, no third entry is named."""
    rng = np.random.default_rng(4)
    named = 0
    for index in range(60):
        sample, first = printed_sample(index, rng).with_slip(SLIPS[index % len(SLIPS)], rng)
        sample, second = sample.with_slip(SLIPS[index % 5], rng)
        name, reason = classify(sample.file())
        if name == ANOTHER_PLANT:
            assert reason.startswith((f"{first.entry} = ", f"{second.entry} = ")), (first, second)
            named += 1
    assert named >= 3
