"""Configurations of Section 5 that are simulated in seconds: the project's own with some numbers changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from studies.section5.configuration import Configuration, section5_configuration

#: Table -> field -> value.
Changes = Mapping[str, Mapping[str, Any]]
#: Ten times the paper's step: the gains are smooth, and a flight takes a second.
COARSE: Changes = {"flight": {"step": 1e-3}}
#: A second of flight with the paper's step, which the published law needs.
BRIEF: Changes = {
    "flight": {"duration": 1.0},
    "learning": {"predefined_time": (0.5, 0.5, 0.5, 0.5)},
    "criteria": {"late": (0.5, 1.0), "short_adjustment": 0.5},
}
NOTHING = (0.0,) * 6


def changed(*changes: Changes) -> Configuration:
    """The project's configuration with fields of its tables replaced, one set of changes after the other."""
    configuration = section5_configuration()
    for tables in changes:
        new = {name: replace(getattr(configuration, name), **fields) for name, fields in tables.items()}
        configuration = replace(configuration, **new)
    return configuration
