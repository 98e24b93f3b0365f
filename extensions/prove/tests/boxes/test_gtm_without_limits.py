"""Stored certificates of the GTM without state limits. The tests repeat their proofs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_prove.certificate import read_content
from hfa_prove.check.region_boxes import check_region
from hfa_prove.search.shape_boxes import Shape
from hfa_prove.statements.plant import Subject

CERTIFICATES = Path(__file__).parents[1] / "certificates"


def gtm_without_limits() -> Model:
    """Return the GTM without state limits."""
    gtm = load_model("examples/gtm.py:GTM")
    states = {name: signal._replace(min=-np.inf, max=np.inf) for name, signal in gtm.states.items()}
    return replace(gtm, states=states)


def size_of(degree: int) -> float:
    """Verify the stored certificate with a V of this degree, and return the size of its set."""
    model = gtm_without_limits()
    content = json.loads((CERTIFICATES / f"gtm_degree_{degree}.json").read_text())
    statement, witness = read_content(content, Subject(model))
    assert statement.degree == degree
    assert not any(name in statement.loop.limits for name in statement.loop.states)
    check_region(statement, witness)
    return Shape.of_piece(statement.piece, degree).size()


@pytest.mark.slow
def test_a_quartic_proves_a_larger_set() -> None:
    """For the GTM, a quartic V proves a set more than 1.15 times as large as a quadratic V.

    The policy is the LQR. The size of a set is the n-th root of its volume.
    """
    assert size_of(4) > 1.15 * size_of(2)
