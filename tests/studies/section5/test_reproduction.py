"""Which experiments there are, by name."""

from __future__ import annotations

import pytest

from hfa_model import published_models
from hfa_support import BadInputError
from studies.section5.reproduction import ALL, EXPERIMENTS, experiments
from studies.section5.setting import CASE_I, CASE_II


def test_a_section_is_one_experiment_and_all_are_all_of_them() -> None:
    assert [each.section for each in experiments(ALL)] == list(EXPERIMENTS)
    for name, experiment in EXPERIMENTS.items():
        assert experiments(name) == (experiment,)


def test_another_name_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(BadInputError, match=r"there is no experiment '5\.9'; choose from 5.*, all$"):
        experiments("5.9")


def test_the_two_cases_are_the_printed_aircraft() -> None:
    assert [model.dihedral_deg for model in published_models()] == [CASE_I, CASE_II]
