"""Commands about the HFA alone, which compare it with what is printed."""

from __future__ import annotations

import argparse

from hfa.options import trims
from hfa.options.argument_types import whole
from hfa.options.parser import Option, Options, command
from hfa.output import ProgressLine, show

#: Suffix of a parameters file.
PARAMETERS = ".toml"


def _options() -> Options:
    return {**trims.HFA_OPTIONS, **trims.output()}


@command(_options)
def regenerate(arguments: argparse.Namespace) -> int:
    """Regenerate both printed pairs (A, B) from one aircraft and compare them with the printed
    ones, entry by entry.

    Exit code 1 when a check fails.
    """
    from verification.regeneration import regenerate_all

    found = regenerate_all(trims.hfa_of(arguments))
    show(found.report(), arguments)
    return 0 if found.ok else 1


@command(_options)
def validate(arguments: argparse.Namespace) -> int:
    """Compare the model with what others have printed and released: a third printed model, and a
    simulation's trims.

    Exit code 1 when a difference is beyond its limit.
    """
    from verification.validation import validate

    found = validate(trims.hfa_of(arguments))
    show(found.report(), arguments)
    return 0 if found.ok else 1


def _identification() -> Options:
    seed = Option("seed of the rough guesses; default 0", "N", whole(0), 0)
    return {"--seed": seed, **trims.output(PARAMETERS, what=" (the parameters)")}


@command(_identification)
def identify(arguments: argparse.Namespace) -> int:
    """Find the aircraft's parameters from the printed matrices and say how far to trust them."""
    from trim.identification import run_identification

    target = arguments.output
    as_parameters = target is not None and target.suffix.lower() == PARAMETERS
    if as_parameters:
        trims.refuse_si(arguments, "a parameters file is in ft, slug, lbf")
    result = run_identification(arguments.seed, ProgressLine("identify"))
    if as_parameters:
        result.fit.save(target)
    show(result.report(), arguments, written=as_parameters)
    return 0
