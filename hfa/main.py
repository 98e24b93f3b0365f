"""Entry point of `hfa`: finds the command, imports only what it needs, turns failures into one
line."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import inspect
import io
import itertools
import os
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from hfa.entry import INTERRUPTED
from hfa.options.parser import Command, Option, Parser, unknown
from hfa_support.errors import BadInputError, NoSolutionError, on_one_line, shortened
from hfa_support.progress import drop, say_aside
from hfa_support.version import VERSION

DONE, FAILED, BAD_INPUT = 0, 1, 2
#: Exceptions that are the user's to answer, each in one line; any other is a bug.
FAILURES = (BadInputError, NoSolutionError, OverflowError, UnicodeError, MemoryError, OSError)
#: Options whose values are files that a command writes.
_WRITTEN = ("output", "picture")
#: Of warnings of the libraries that compute.
_MOST_NOTES = 5

#: Group -> an example, and its commands with what they do.
GROUPS = {
    "model": (
        "hfa linearize --dihedral 10 -o model.mat",
        {
            "trim": "trim the aircraft and report variables, limits, residuals, loads, performance",
            "linearize": "exact linear model A, B at a trim, with modes, offsets and uncertainty bands",
            "sweep": "trims and linear models over a grid, modes tracked",
            "identify": "find the aircraft's parameters from the printed matrices",
            "regenerate": "regenerate both printed pairs (A, B) and compare them entry by entry",
            "validate": "compare the model with a third printed model and with a released simulation",
            "report": "the main job on one page: trims, models, games, critics, a slider over the dihedral angle",
        },
    ),
    "critic": (
        "hfa verify --dihedral 15 --weights mine.npz",
        {
            "solve": "exact solution of the zero-sum game, with certificate and smallest delta",
            "learn": "learn the value and the gain of the game with a critic",
            "verify": "compare a learned critic with the exact game solution",
        },
    ),
    "flight": (
        "hfa fly --dihedral 15 --gust 400:5",
        {
            "fly": "simulate a policy on the nonlinear aircraft and compare with the linear prediction",
            "schedule": "simulate a slow change of dihedral under a schedule of certified gains",
            "monte-carlo": "simulate many members of one flight with parameter errors, noise and turbulence",
            "design": "the certified controller of a design at every dihedral angle, as one file",
        },
    ),
    "proof": (
        "hfa prove schedule --dihedral 14:15",
        {
            "prove": "stability between the points of a schedule, proved in ball arithmetic for every angle",
            "lpv": "linear models on the coarsest grid of dihedrals with a proved interpolation error",
        },
    ),
    "exchange": (
        "hfa export --dihedral 15 -o folder",
        {"export": "the aircraft for other tools: C source, FMU, MATLAB"},
    ),
}
COMMANDS = {name: about for _, commands in GROUPS.values() for name, about in commands.items()}

#: Command -> its module in `hfa.commands`, imported when it runs; the others have one of their own
#: name.
MODULES = {
    **dict.fromkeys(("identify", "regenerate", "validate"), "printed"),
    **dict.fromkeys(("solve", "learn"), "game"),
    **dict.fromkeys(("fly", "schedule", "monte-carlo"), "flight"),
    "lpv": "prove",
}

#: Commands that take a user's own aircraft.
WITH_AIRCRAFT = set(COMMANDS) - {"identify", "regenerate", "validate", "report"}

#: Former commands, for one release -> the study that took their place.
MOVED = {"reproduce": "section5", "study": "update_law", "servo": "servo"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns 0 done, 1 a check failed or no solution exists, 2 bad usage or
    input."""
    # Matrices of six rows gain nothing from threads and lose much to them; must be set before NumPy
    # loads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = list(sys.argv[1:] if argv is None else argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that has no "±" shows "?"
    code = DONE
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter(
            "always", UserWarning
        )  # the project's own are notes, whatever PYTHONWARNINGS says
        try:
            code = _run(words)
            if sys.stdout is not None:
                sys.stdout.flush()  # here, so that what goes wrong is reported below and not after the end
        except BrokenPipeError:  # of --help, or of what was left to flush
            drop(sys.stdout)
            return code
        except (*FAILURES, KeyboardInterrupt) as error:
            message, code = _failure(error)
            if isinstance(error, OSError):
                drop(sys.stdout)
            say_aside("hfa: " + on_one_line(message))
            return code
    if not {"-q", "--quiet"} & set(words):
        _say_warnings(caught)
    return code


def _failure(error: BaseException) -> tuple[str, int]:
    """What one of `FAILURES`, or Ctrl-C, is to the user of the command, and its exit code."""
    match error:
        case NoSolutionError():
            return str(error), FAILED
        case KeyboardInterrupt():
            return "interrupted", INTERRUPTED
        case OverflowError():
            return (
                "a number is too large or too small to compute with; check the options",
                BAD_INPUT,
            )
        case UnicodeError():
            return (
                "a name holds half a character, which no file can have; choose another",
                BAD_INPUT,
            )
        case MemoryError():
            return "not enough memory; ask for fewer points or a shorter flight", BAD_INPUT
        case OSError(filename=None):
            return f"cannot write the output: {error.strerror or error}", BAD_INPUT
        case OSError():
            return f"{error.filename}: {error.strerror}; choose another place", BAD_INPUT
    return str(error), BAD_INPUT


def _run(words: list[str]) -> int:
    """Parse the words and run the command that they name."""
    with _as_named(words):
        try:
            command, arguments = _parsed(words)
        except SystemExit:
            return DONE  # how argparse leaves after --help and --version
        _refuse_same_file(words[1:], arguments)
        quiet = (
            contextlib.redirect_stderr(io.StringIO())
            if arguments.quiet
            else contextlib.nullcontext()
        )
        with quiet:
            return command.run(arguments)


@contextlib.contextmanager
def _as_named(words: list[str]) -> Iterator[None]:
    """The units that --units names, and the model of --aircraft, whose file is run, or of
    `--dynamics unsteady`: the other options are read in its names and units. Wrong words are
    refused when they are parsed."""
    named = _value_of("--aircraft", words) if words[:1] and words[0] in WITH_AIRCRAFT else None
    lagging = (
        words[:1] and words[0] in WITH_AIRCRAFT and _value_of("--dynamics", words) == "unsteady"
    )
    with contextlib.ExitStack() as around:
        if _value_of("--units", words) == "si":
            from hfa_support.reporting.unit_system import shown_in

            around.enter_context(shown_in("si"))
        if named or lagging:
            from hfa.options.argument_types import OWN

            if named:
                from hfa_aircraft.model import load_model

                model = load_model(named)
            else:
                from hfa_model.unsteady import UNSTEADY as model
            around.callback(OWN.reset, OWN.set(model))
        yield


def _value_of(option: str, words: list[str]) -> str | None:
    """The last value of an option among words that are not parsed yet."""
    given = [value for word, value in itertools.pairwise(words) if word == option]
    given += [word.removeprefix(f"{option}=") for word in words if word.startswith(f"{option}=")]
    return given[-1] if given else None


def _refuse_same_file(words: Sequence[str], arguments: argparse.Namespace) -> None:
    """BadInputError when a file that the command writes is also an input of it, or another of its
    outputs."""
    values = [
        part
        for word in words
        for part in (word, word.partition("=")[2], word[2:] if word[:2] == "-o" else "")
    ]
    named = Counter(os.path.abspath(value) for value in values if value)
    for name in _WRITTEN:
        path = getattr(arguments, name, None)
        if path is not None and named[os.path.abspath(path)] > 1:
            raise BadInputError(
                f"--{name} {path} is named twice; give each file that is written a name of its own"
            )


def _say_warnings(caught: Iterable[warnings.WarningMessage]) -> None:
    """What was warned of, a note each, once there is a result: the message of a failure is
    enough."""
    from hfa.output import say_notes

    own = [str(each.message) for each in caught if each.category is UserWarning]
    others = [
        f"while computing: {each.message}; check the result"
        for each in caught
        if each.category is not UserWarning
    ]
    say_notes((*dict.fromkeys(own), *list(dict.fromkeys(others))[:_MOST_NOTES]))


def _parsed(words: list[str]) -> tuple[Command, argparse.Namespace]:
    chosen = words[0] if words else "--help"
    if chosen not in COMMANDS:
        if chosen in MOVED:
            study = MOVED[chosen]
            raise BadInputError(
                f"`hfa {chosen}` is a study now: run python -m studies.{study} in the repository"
            )
        overview().parse_words([chosen])
        raise BadInputError(
            unknown(f"command {shortened(chosen)!r}", chosen.lower(), COMMANDS, "hfa")
        )
    parser = Parser(prog=f"hfa {chosen}")
    command = filled(parser, chosen)
    return command, parser.parse_words(words[1:])


def filled(parser: Parser, name: str) -> Command:
    """Give a parser the options of a command; the command."""
    from hfa.options.trims import IN_FEET, UNITS

    module = importlib.import_module(f"hfa.commands.{MODULES.get(name, name)}")
    command: Command = getattr(module, name.replace("-", "_"))
    parser.description = inspect.cleandoc(command.run.__doc__ or "")
    parser.declare({"-q --quiet": Option("no notes and no progress; errors are still said")})
    parser.declare({**command.options(), **(UNITS if name not in IN_FEET else {})})
    return command


def overview() -> Parser:
    """`hfa` without a command: --help and --version."""
    parser = Parser(
        prog="hfa",
        usage="hfa [--version] command ...  (hfa command --help)",
        description="Trims, linear models, games, flights and proofs; critics checked against the exact solution.",
        epilog="\n\n".join(
            f"{group}, for example {example}\n"
            + "\n".join(f"  {name:<12}{text}" for name, text in commands.items())
            for group, (example, commands) in GROUPS.items()
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", nargs="?", help=argparse.SUPPRESS)
    about = argparse.SUPPRESS
    parser.add_argument("--version", action="version", version=f"hfa {VERSION}", help=about)
    return parser
