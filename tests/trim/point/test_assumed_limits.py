"""Limits that no data of an aircraft state are marked as assumed."""

from dataclasses import replace

from project import ROOT

import hfa
from trim import usual_condition


def test_a_limit_of_the_user_or_of_the_model_is_not_assumed():
    """The flexible aircraft and an aircraft from a table state no limits of alpha: those of the reader are
    marked as assumed in the margins. Limits that the user gives, or the GTM declares, are not.
    """
    for model in (hfa.aircraft(), hfa.load_model(f"{ROOT}/examples/uav.toml")):
        margins = hfa.trim(model).margins
        assert margins["alpha"].assumed
        own = replace(usual_condition(model), limits={"alpha": (-0.1, 0.2)})
        assert not hfa.trim(model, own).margins["alpha"].assumed
    gtm = hfa.trim(hfa.load_model(f"{ROOT}/examples/gtm.py:GTM")).margins
    assert [gtm[name].assumed for name in ("alpha", "pitch")] == [False, False]
