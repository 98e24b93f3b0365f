"""The command `hfa trim`."""

from __future__ import annotations

import argparse

import hfa_model
from hfa.options import trims
from hfa.options.parser import Options, command
from hfa.output import draw, failure_as_data, show
from trim.hfa.hfa_report import trim_figure, trim_report


def _options() -> Options:
    picture = trims.picture("the aircraft from the front with its loads")
    return {**trims.trim(required=True), **picture, **trims.output()}


@command(_options)
def trim(arguments: argparse.Namespace) -> int:
    """Trim the aircraft and report variables, limits, what binds, each equation's verdict, loads
    and performance."""
    aircraft = trims.aircraft_of(arguments)
    if not hfa_model.is_hfa(aircraft):
        trims.refuse(
            arguments, ("picture",), "draws the HFA from the front; leave it out with --aircraft"
        )
    with failure_as_data(arguments, aircraft):
        point = trims.point_of(arguments, aircraft)
    draw(arguments, lambda: trim_figure(trims.hfa_of(arguments), point))
    show(trim_report(aircraft, trims.condition_of(arguments), point), arguments)
    return 0
