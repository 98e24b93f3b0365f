"""The study `python -m studies.identification` reproduces the packaged parameters."""

import json

import numpy as np
import pytest

from hfa.paper import default_parameters
from hfa_model import load_parameters
from studies.alone import run_alone
from studies.identification.__main__ import identification
from studies.identification.parameters import ALTERNATIVES


@pytest.mark.slow
def test_the_study_writes_the_packaged_parameters(folder, capsys):
    """The study writes the packaged parameters, standard errors and notes, also as JSON."""
    words = ["-o", "mine.TOML", "--json"]
    assert run_alone(identification, "python -m studies.identification", words) == 0
    text = capsys.readouterr().out
    data = json.loads(text)
    # The results are not bit-identical, because rounding differs between processors.
    found = load_parameters("mine.TOML")
    committed = default_parameters()
    assert found.sources == committed.sources
    assert found.notes == committed.notes
    assert found.values._asdict() == pytest.approx(committed.values._asdict(), rel=1e-8)
    assert found.standard_errors == pytest.approx(committed.standard_errors, rel=1e-4)
    assert {
        name: row["value"] for name, row in data["parameters"].items()
    } == found.values._asdict()
    errors = {
        name: row["standard_error"]
        for name, row in data["parameters"].items()
        if row["standard_error"]
    }
    assert errors == pytest.approx(found.standard_errors, rel=1e-12)
    assert len(data["entries"]) == 132  # of A (6, 6) and B (6, 5), at two angles
    assert np.sum([entry["half_units"] ** 2 for entry in data["entries"]]) == pytest.approx(
        data["sum_of_squares"]
    )
    assert [row["description"] for row in data["structures"]] == [
        "published",
        *(name for name, _ in ALTERNATIVES),
    ]
