"""Entry point of `hfa`: finds the command, imports only what it needs, turns failures into one line."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from hfa_model.support.errors import BadInputError, NoSolutionError
from hfa_model.support.version import toolchain_version

DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

#: Command -> what it does, in the order of `hfa --help`. The module of a command is imported when it runs.
COMMANDS = {
    "trim": "trim the aircraft and report state, inputs, residuals, loads and margins",
    "linearize": "exact linear model A, B at a trim, with modes, offsets and uncertainty bands",
    "sweep": "trims and linear models over a grid, modes tracked",
    "identify": "find the aircraft's parameters from the printed matrices",
    "regenerate": "regenerate both printed pairs (A, B) and compare them entry by entry",
    "validate": "compare the model with a third printed model and with a released simulation",
    "solve": "exact solution of the zero-sum game, with certificate and smallest delta",
    "learn": "learn the value and the gain of the game with a critic",
    "verify": "a learned critic against the exact game solution",
    "study": "the paper's update law as printed, every setting, with causes; takes minutes",
    "fly": "fly a policy on the nonlinear aircraft, against its linear prediction; the recoverable set",
    "monte-carlo": "fly many members of one flight with parameter errors, noise and turbulence, on any workers",
    "reproduce": "fly Section 5 of the paper again: its figures, and its claims with numbers",
    "report": "the main job on one page: regeneration and the sweep, with pictures",
}


class _Once(argparse.Action):
    """Store the word of an option; an option that comes twice is an error, and not the last one wins."""

    _given: Any = None

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        if self._given is not None:
            raise argparse.ArgumentError(self, f"given twice, as {self._given!r} and as {values!r}; give it once")
        self._given = values
        setattr(namespace, self.dest, values)


class _Parser(argparse.ArgumentParser):
    """An argument parser whose complaints are one line, and whose options are given once."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.register("action", None, _Once)

    def error(self, message: str) -> NoReturn:
        raise BadInputError(f"{message} (see `{self.prog} --help`)")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns 0 done, 1 a check failed or no solution exists, 2 bad usage or input."""
    # Matrices of six rows gain nothing from threads and lose much to them; must be set before NumPy loads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = list(sys.argv[1:] if argv is None else argv)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal that has no "±" shows "?"
    code = DONE
    try:
        code = _run(words)
        if sys.stdout is not None:
            sys.stdout.flush()  # here, so that what goes wrong is reported below and not after the end
        return code
    except BadInputError as error:
        return _complain(str(error), BAD_INPUT)
    except NoSolutionError as error:
        return _complain(str(error), FAILED)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        _drop_output()  # the reader of our output left (`hfa ... | head`): nothing more to say
        return code
    except MemoryError:
        return _complain("not enough memory; ask for fewer points or a shorter flight", BAD_INPUT)
    except OSError as error:
        _drop_output()
        return _complain(f"{error.filename or 'cannot write the output'}: {error.strerror}", BAD_INPUT)


def _run(words: list[str]) -> int:
    """Parse the words and run the command that they name."""
    try:
        module, arguments = _parsed(words)
    except SystemExit:
        return DONE  # how argparse leaves after --help and --version
    return int(module.run(arguments))


def _parsed(words: list[str]) -> tuple[Any, argparse.Namespace]:
    parser = _Parser(
        prog="hfa",
        description="Linear models and checked controllers of a highly flexible aircraft.",
        epilog="commands:\n" + "\n".join(f"  {name:<12}{text}" for name, text in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", choices=COMMANDS, metavar="command", help="one of the commands below")
    parser.add_argument("--version", action="version", version=f"hfa {toolchain_version()}")
    chosen = parser.parse_args(words[:1] or ["--help"]).command
    module = importlib.import_module(f"hfa_cli.commands.{chosen.replace('-', '_')}")
    command = _Parser(prog=f"hfa {chosen}", description=(module.__doc__ or "").strip(), allow_abbrev=False)
    module.add_arguments(command)
    return module, command.parse_args(_attached(words[1:]))


def _attached(words: list[str]) -> list[str]:
    """`--option -5:5:1` as `--option=-5:5:1`: argparse takes a word with a "-" for an option, plain numbers apart."""
    result: list[str] = []
    for word in words:
        if result and re.fullmatch(r"--[\w-]+", result[-1]) and re.match(r"-[\d.]", word):
            result[-1] += f"={word}"
        else:
            result.append(word)
    return result


def _drop_output() -> None:
    """Send what is still buffered for standard output nowhere, so that nothing fails when the process ends."""
    with contextlib.suppress(AttributeError, io.UnsupportedOperation):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _complain(message: str, code: int) -> int:
    print("hfa: " + " ".join(message.split()), file=sys.stderr)
    return code
