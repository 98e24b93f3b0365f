"""Stores in metric units."""

import pytest
from units_of_outputs import assert_store_in_metres


@pytest.mark.slow
def test_stores_in_si_and_english_units_agree(tmp_path):
    """A store in metric units contains the converted numbers of a store in English units."""
    assert_store_in_metres("sweep", "--dihedral", "5,15", folder=tmp_path)
