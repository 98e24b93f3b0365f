"""Trims and linear models over a grid of conditions; modes tracked, failures kept as rows.

A sweep that outgrows memory goes to a Zarr store (-o FILE.zarr): any number of points, any parameter of the
aircraft (--vary), random samples (--samples), several processes (--workers) or machines (--scheduler), and it can be
continued after an interruption (--resume).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from hfa_cli import options
from hfa_cli.output import SUFFIXES, Progress, check_target, deliver, say_notes
from hfa_cli.values import axis, grid, quantity, span, split_assignments, whole
from hfa_model.support.errors import BadInputError
from trim.sweeps.sweep import MOST_POINTS, SWEPT, sweep
from trim.sweeps.sweep_report import sweep_table, sweep_text, sweep_warnings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa sweep`."""
    for name, unit in zip(SWEPT, ("deg", "ft/s", "ft", "deg"), strict=True):
        parser.add_argument(f"--{name}", metavar="RANGE", help=f"start:stop:step, a,b,c or one number, {unit}")
    parser.add_argument("--full", action="store_true", help="seven states, with altitude")
    parser.add_argument("--picture", metavar="FILE", help="draw the root locus (.png or .svg)")
    options.add_aircraft(parser)
    options.add_output(parser, " or .zarr")
    store = parser.add_argument_group("for a store (-o FILE.zarr)")
    store.add_argument("--vary", action="append", metavar="NAME=RANGE", help="also vary a parameter; repeatable")
    store.add_argument(
        "--samples", metavar="N", help="N points of a Latin hypercube; ranges are LOW:HIGH or one number"
    )
    store.add_argument("--seed", metavar="N", help="seed of the samples; default 0")
    store.add_argument("--workers", metavar="N", help="processes; default 1")
    store.add_argument("--scheduler", metavar="URL", help="Dask scheduler, tcp://host:port")
    store.add_argument("--resume", action="store_true", help="continue an interrupted sweep")


def run(arguments: argparse.Namespace) -> int:
    """Sweep and report; exit 1 when no point has a trim."""
    words = {name: getattr(arguments, name) for name in SWEPT if getattr(arguments, name) is not None}
    for name, text in split_assignments(arguments.vary).items():
        if name in words:
            raise BadInputError(f"{name} is given twice, by --{name} and by --vary; give it once")
        words[name] = text
    if not words:
        raise BadInputError(f"nothing to sweep; give at least one of {', '.join('--' + name for name in SWEPT)}")
    if arguments.output is not None and Path(arguments.output).suffix.lower() == ".zarr":
        return _to_store(arguments, words)
    for name in ("vary", "samples", "seed", "workers", "scheduler", "resume"):
        if options.given(arguments, name):
            raise BadInputError(f"--{name} needs a store; add -o FILE.zarr")
    target = check_target(arguments.output, (*SUFFIXES, ".zarr"))
    picture = check_target(arguments.picture, (".png", ".svg"))
    axes = {name: grid(name, text, MOST_POINTS) for name, text in words.items()}
    axes = dict(sorted(axes.items(), key=lambda axis: axis[1].size > 1))  # what stays fixed first: it is not drawn
    varied = [name for name, values in axes.items() if values.size > 1]
    if picture is not None and len(varied) > 1:
        raise BadInputError(f"--picture draws a sweep in one variable, not in {' and '.join(varied)}; fix all but one")
    result = sweep(options.aircraft_of(arguments), axes, full=arguments.full, progress=Progress("sweep"))
    if picture is not None:
        from trim.sweeps.root_locus import root_locus

        root_locus(result, picture)
    warnings = sweep_warnings(result)
    deliver(
        result.to_dict() | {"warnings": warnings},
        lambda: sweep_text(result),
        lambda: sweep_table(result),
        as_json=arguments.json,
        target=target,
    )
    say_notes(warnings)
    return 0 if np.any(result.trimmed) else 1


def _to_store(arguments: argparse.Namespace, words: dict[str, str]) -> int:
    from trim.sweeps.stored_sweep import stream_sweep
    from trim.sweeps.stored_sweep_report import store_data, store_text
    from trim.sweeps.sweep_plan import MOST_POINTS as MOST_STORED, SweepPlan

    for name in ("full", "picture"):
        if options.given(arguments, name):
            raise BadInputError(f"--{name} does not go with a store, which holds all seven states and no picture")
    path = check_target(arguments.output, (".zarr",))
    assert path is not None
    samples = whole("--samples", arguments.samples, 0, lowest=1)
    if arguments.seed is not None and not samples:
        raise BadInputError("--seed belongs to --samples; a grid has nothing random")
    options.one_place(arguments)
    axes = _ranges(words) if samples else {name: axis(name, text, MOST_STORED) for name, text in words.items()}
    seed = whole("--seed", arguments.seed, 0, lowest=0)
    plan = SweepPlan(axes, options.parameters_of(arguments).values, arguments.dynamics, samples, seed)
    store = stream_sweep(
        plan,
        path,
        count=whole("--workers", arguments.workers, 1, lowest=1),
        scheduler=arguments.scheduler,
        resume=arguments.resume,
        progress=Progress("sweep"),
    )
    data = store_data(plan, store, path)
    print(json.dumps(data, indent=2) if arguments.json else store_text(data))
    say_notes(data["warnings"])
    return 0 if data["counts"]["trimmed"] else 1


def _ranges(words: dict[str, str]) -> dict[str, tuple[float, ...]]:
    """Lowest and highest value of each variable of random samples; one number is a constant."""
    if not any(":" in text for text in words.values()):
        raise BadInputError(f"--samples has nothing to draw; give one of {', '.join(words)} as LOW:HIGH")
    return {
        name: span(name, text) if ":" in text else (quantity(name, text), quantity(name, text))
        for name, text in words.items()
    }
