"""Every way in to `hfa`: a command with a file that it takes, and how a string of bytes makes that file hostile."""

from __future__ import annotations

import argparse
import importlib
import json
import tempfile
from collections.abc import Callable, Mapping
from contextlib import chdir
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from cli import hfa
from game_files import small
from hostile import Choices, hostile_bytes, hostile_mat, hostile_npz, hostile_text, hostile_words

from hfa_cli.main import COMMANDS
from hfa_support.reporting.data_files import SUFFIXES

Change = Callable[[bytes, Choices], bytes]
_CHANGES: dict[str, Change] = {".npz": hostile_npz, ".mat": hostile_mat}
_AT = ("--dihedral", "15")
_FLOWN = (*_AT, "--duration", "0.02", "--step", "0.01")
_MEMBERS = ("monte-carlo", *_AT, "--gain", "gain.json", "--members", "5", "--duration", "0.1", "-o", "members.zarr")
_SWEPT = ("sweep", "--dihedral", "5:8:1", "-o", "points.zarr")
_TUNED = ("design", "--tune", "tune.toml", "-o", "best.toml")
_PROVED = ("prove", "schedule", "--dihedral", "15:15.001")
_SOLVED = ("hfa_cli.commands.solve.analyse_game",)
_CHECKED = ("hfa_cli.commands.verify.check_critic", "hfa_cli.commands.verify.check_history")
_FLIGHT = ("controller.flight.nonlinear_flight.fly",)
_PROOF = ("verification.proof.schedule_proof.prove_schedule",)
_SEARCH = (
    "verification.synthesis.design_evaluation.DesignEvaluation.at",
    "verification.synthesis.tuning_report.tuning_report",
)
_CHUNK = "hfa_support.jobs.stream.run_and_write"
_POINTS = (_CHUNK, "trim.sweeps.stored_sweep.stored_sweep_report")
_FLIGHTS = (_CHUNK, "controller.flight.monte_carlo.MonteCarloResult.of")
#: What takes minutes with one word less, on all processors: of one input in a thousand.
_MINUTES = ("verification.servo.servo_flights.run_case",)
#: A condition file that every command takes.
CONDITION = """description = "slow"
free = ["speed"]
[impose]
alpha_deg = [[0, 5.0], [20, 6.0]]
altitude = 1000.0
[limits]
elevator_center_deg = [-30, 30]
"""


class Case(NamedTuple):
    """A command line, and the files that are there before."""

    words: list[str]
    files: dict[str, bytes]


class Way(NamedTuple):
    """words: a command; "{}" in it is the file that becomes hostile. file: its name among those of `seeds`.

    beside: other files that the command needs. A file whose name ends in .zarr is a store, with one file of it hostile.
    work: the functions that the command calls once the file has been read.
    """

    words: tuple[str, ...]
    file: str = ""
    beside: tuple[str, ...] = ()
    work: tuple[str, ...] = ()

    def case(self, content: bytes) -> Case:
        """What the bytes make of this way in."""
        choices = Choices(content)
        if not self.file:
            command, *rest = choices.of(COMMAND_LINES).split()
            return Case([command, *hostile_words(rest, options(command), choices)], {})
        known = seeds()
        result = {name: known[name] for name in self.beside}
        names = [name for name in known if name == self.file or name.startswith(f"{self.file}/")]
        result |= {name: known[name] for name in names}
        changed = choices.of(names)
        if changed == self.file or choices.below(4):
            result[changed] = _change(changed)(known[changed], choices)
        else:
            del result[changed]
        return Case(list(self.words), result)


def _change(name: str) -> Change:
    if ".zarr" in name and not name.endswith(".json"):
        return hostile_bytes
    return _CHANGES.get(Path(name).suffix, hostile_text)


#: Command lines that are short to run; what they are changed to may be long and is then announced.
COMMAND_LINES = (
    "trim --dihedral 15 --free speed --hold throttle=40 --limit alpha=-5:15 -o a.json",
    "linearize --dihedral 5 --states alpha,pitch --outputs speed --json",
    "sweep --dihedral 0:20:10 --alpha 1:2:0.5 --format markdown -o a.csv",
    "sweep --dihedral 0:20 --vary panel_mass=0.5:2 --samples 5 --seed 1 -o a.zarr",
    "solve --dihedral 15 --delta 300 --Q 1,1,1,1,1,1 --R 1,1,1,1,1",
    "solve --dihedral 15 --design simvfa-1 -o a.mat",
    "verify --dihedral 15 --law irl --seed 3 --limit-error 0.1 --limit-cost 5",
    "learn --dihedral 15 --law certified --set predefined_time=2 -o a.npz",
    "fly --dihedral 15 --duration 0.02 --initial speed=1 --gust 25:3:0 --turbulence 1:500 --noise alpha=0.1:1:3",
    "fly --dihedral 15 --duration 0.02 --actuators 0.1:60:2 --engine 1:0.1 --fault 0.5:1:0 --error panel_mass=1.1",
    "map --dihedral 15 --speeds -1:1:1 --dihedrals 0 --commands 0,1 --envelope alpha=-5:15",
    "monte-carlo --dihedral 15 --members 3 --duration 0.02 --error panel_mass=0.1 --noise alpha=0.1 -o a.zarr",
    "schedule --dihedral 15 --to 15.1 --over 0.1 --points 2 --duration 0.1 --law exact --disturbance alpha=0:0.1:1",
    "prove solution --dihedral 15",
    "lpv --dihedral 10:10.1 --tolerance 0.01 -o a.c",
    "design --design simvfa-1 --dihedral 10 --feedback state -o a.npz",
    "prove --check a.json",
    "export --formats a.json",
    "export --dihedral 15 --c folder",
    "regenerate --dynamics newton --parameters identified --json",
    "study",
    "servo nothing -o folder",
    "report --dihedral 5 --claims nothing",
)
WAYS = {
    "command line": Way((), work=_MINUTES),
    "parameters.toml": Way(("trim", *_AT, "--parameters", "{}"), "parameters.toml"),
    "condition.toml": Way(("trim", *_AT, "--condition", "{}"), "condition.toml"),
    "condition.toml of a sweep": Way(
        ("sweep", "--dihedral", "10,15", "--condition", "{}"), "condition.toml", work=("hfa_cli.commands.sweep.sweep",)
    ),
    "design.toml": Way(("solve", *_AT, "--design", "{}", "--json"), "design.toml", work=_SOLVED),
    "point.json": Way(("trim", *_AT, "--start", "{}"), "point.json"),
    **{
        f"plant{each}": Way(("solve", "--model", "{}"), f"plant{each}", work=_SOLVED)
        for each in (".json", ".npz", ".mat")
    },
    "A.csv": Way(("solve", "--model", "{}", "--Q", "1,1", "--R", "1", "--delta", "inf"), "A.csv", ("B.csv",), _SOLVED),
    **{
        f"{what}{each}": Way(
            ("verify", "--model", "plant.json", "--weights", "{}"), f"{what}{each}", ("plant.json",), _CHECKED
        )
        for what in ("critic", "history")
        for each in SUFFIXES
    },
    **{f"gain{each}": Way(("fly", *_FLOWN, "--gain", "{}"), f"gain{each}", work=_FLIGHT) for each in SUFFIXES},
    "controller.npz": Way(
        ("fly", *_FLOWN, "--controller", "{}", "--actuators", "0.5:60"), "controller.npz", work=_FLIGHT
    ),
    "table.json": Way((*_PROVED, "--table", "{}"), "table.json", work=_PROOF),
    "table.npz": Way((*_PROVED, "--table", "{}"), "table.npz", work=_PROOF),
    **{each: Way(("prove", "--check", "{}"), each) for each in ("certificate.json", "game.json", "lpv.json")},
    "certificate.json to resume": Way(
        (*_PROVED, "--table", "table.json", "--resume", "-o", "{}"), "certificate.json", ("table.json",), _PROOF
    ),
    "tune.toml": Way(("design", "--tune", "{}", "-o", "best.toml"), "tune.toml", ("own.toml",), _SEARCH),
    "best.toml.record": Way(_TUNED, "best.toml.record", ("tune.toml", "own.toml"), _SEARCH),
    "claims.json": Way(
        ("report", "--dihedral", "5", "--sweep", "5", "--claims", "{}", "--json"),
        "claims.json",
        work=("hfa_cli.commands.report.main_job",),
    ),
    "points.zarr": Way((*_SWEPT, "--resume"), "points.zarr", work=_POINTS),
    "members.zarr": Way((*_MEMBERS, "--resume"), "members.zarr", ("gain.json",), _FLIGHTS),
}


@cache
def options(command: str) -> tuple[str, ...]:
    """The options of a command, without those that start processes or look for machines."""
    if command not in COMMANDS:
        return ("--help",)
    parser = argparse.ArgumentParser(add_help=False)
    importlib.import_module(f"hfa_cli.commands.{command.replace('-', '_')}").add_arguments(parser)
    return tuple(name for name in parser._option_string_actions if name not in ("--workers", "--scheduler"))


@cache
def seeds() -> Mapping[str, bytes]:
    """Files as the commands write them, name -> content; those of a store by their path."""
    from controllers import small_controller
    from proof_cases import exact_table
    from servo_cases import write_tuning

    from controller import save_controller
    from hfa_model.aircraft import Aircraft
    from hfa_model.parameters import default_parameters, save_parameters

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_parameters(default_parameters(), folder / "parameters.toml", "a copy")
        (folder / "condition.toml").write_text(CONDITION, encoding="utf-8")
        (folder / "design.toml").write_bytes(files("controller.designs").joinpath("simvfa_1.toml").read_bytes())
        save_controller(folder / "controller.npz", small_controller(Aircraft(default_parameters().values, "published")))
        table = exact_table(14.9, 15.1)
        np.savez(folder / "table.npz", dihedral_deg=table.dihedral_deg, K=table.K)
        content = {"dihedral_deg": table.dihedral_deg.tolist(), "K": table.K.tolist()}
        (folder / "table.json").write_text(json.dumps(content))
        for suffix in (".json", ".npz", ".mat"):
            small(folder / f"plant{suffix}")
        (folder / "A.csv").write_text("a,b\n-0.2,1.0\n-2.0,-0.3\n")
        (folder / "B.csv").write_text("u\n0.0\n1.0\n")
        _run(folder, ("trim", *_AT, "-o", "{}"), "point.json")
        _run(folder, (*_SWEPT[:-1], "{}"), "points.zarr")
        _run(folder, (*_PROVED, "--table", str(folder / "table.json"), "-o", "{}"), "certificate.json")
        _run(folder, ("prove", "solution", *_AT, "-o", "{}"), "game.json")
        _run(folder, ("lpv", "--dihedral", "15:15.01", "--certificate", "{}"), "lpv.json")
        (folder / "claims.json").write_text(json.dumps(_few_claims()))
        with chdir(folder):  # the name of the design is part of what the record is known by
            write_tuning(Path(), design="own.toml", evaluations=1)
            assert hfa(*_TUNED).code == 1  # a corner stays unstable
        for suffix in SUFFIXES:
            _run(folder, ("solve", *_AT, "-o", "{}"), f"gain{suffix}")
            _run(folder, ("solve", "--model", str(folder / "plant.json"), "-o", "{}"), f"critic{suffix}")
            learn = ("learn", "--model", str(folder / "plant.json"), "--set", "tick=0.5", "-o", "{}")
            _run(folder, learn, f"history{suffix}")
        with chdir(folder):
            _run(folder, _MEMBERS, "members.zarr")
        return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _few_claims() -> dict[str, Any]:
    table = json.loads((Path(__file__).parents[2] / "studies/section5/results/claims.json").read_bytes())
    first = table["experiments"][0]
    few = {"claims": table["claims"][:2], "experiments": [first | {"flights": first["flights"][:1]}]}
    return dict(table | few | {"lost_flights": table["lost_flights"][:1]})


def _run(folder: Path, words: tuple[str, ...], name: str) -> None:
    result = hfa(*(str(folder / name) if word == "{}" else word for word in words))
    assert result.code == 0, (words, result.err)
