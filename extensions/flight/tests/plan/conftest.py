"""A best flight that several files examine."""

from pathlib import Path

import pytest

import hfa

GTM = f"{Path(__file__).parents[4] / 'examples' / 'gtm.py'}:GTM"


@pytest.fixture(scope="session")
def gtm():
    model = hfa.load_model(GTM)
    return hfa.optimize(model, hfa.trim(model), {"alpha": 0.15, "pitch": 0.3})
