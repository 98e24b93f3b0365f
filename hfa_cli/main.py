"""Entry point of `hfa`: finds the command, imports only what it needs, turns failures into one line."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from hfa_cli.echo import on_one_line, shortened
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
    """Store the value of an option that is given once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        setattr(namespace, self.dest, values)


class _Parser(argparse.ArgumentParser):
    """An argument parser whose complaints are one line each, the unknown option before the missing one."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, exit_on_error=False, **options)
        self.register("action", None, _Once)

    def parse_words(self, words: list[str]) -> argparse.Namespace:
        """The options and their values; BadInputError says what is wrong with them."""
        words = _attached(words)
        self._check_options(words)
        try:
            return self.parse_args(words)
        except argparse.ArgumentError as error:
            if error.argument_name is None:
                self.error(error.message)
            raise BadInputError(f"{error.argument_name.rpartition('/')[2]} {error.message}") from error

    def error(self, message: str) -> NoReturn:
        raise BadInputError(f"{message} (see `{self.prog} --help`)")

    def _check_options(self, words: list[str]) -> None:
        """What argparse does not see: options that are unknown or given twice, and "--" as a value."""
        known = self._option_string_actions
        given: dict[str, str] = {}
        for word, following in zip(words, [*words[1:], ""], strict=False):
            if word == "--":
                return  # only positional words follow
            if not re.match(r"-[^\d.]", word):
                continue
            option, equals, value = word.partition("=") if word.startswith("--") else (word[:2], word[2:], word[2:])
            if option not in known:
                raise BadInputError(_unknown(f"option {shortened(option)}", option, known, self.prog))
            if equals and value == "--":
                raise BadInputError(f"{option} is '--'; give a value")
            action, text = known[option], value if equals else following
            if isinstance(action, _Once):
                if action.dest in given:
                    raise BadInputError(
                        f"{option} is given twice, as {given[action.dest]!r} and as {text!r}; give it once"
                    )
                given[action.dest] = text


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
    except OverflowError:
        return _complain("a number is too large or too small to compute with; check the options", BAD_INPUT)
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
    with contextlib.redirect_stderr(io.StringIO()) if arguments.quiet else contextlib.nullcontext():
        return int(module.run(arguments))


def _parsed(words: list[str]) -> tuple[Any, argparse.Namespace]:
    chosen = words[0] if words else "--help"
    if chosen not in COMMANDS:
        _overview().parse_words([chosen])
        raise BadInputError(_unknown(f"command {shortened(chosen)!r}", chosen.lower(), COMMANDS, "hfa"))
    module = importlib.import_module(f"hfa_cli.commands.{chosen.replace('-', '_')}")
    command = _Parser(prog=f"hfa {chosen}", description=(module.__doc__ or "").strip())
    command.add_argument("-q", "--quiet", action="store_true", help="no notes and no progress; errors are still said")
    module.add_arguments(command)
    return module, command.parse_words(words[1:])


def _overview() -> _Parser:
    """`hfa` without a command: --help and --version."""
    parser = _Parser(
        prog="hfa",
        usage="hfa [-h] [--version] command ...",
        description="Linear models and checked controllers of a highly flexible aircraft.",
        epilog="commands:\n" + "\n".join(f"  {name:<12}{text}" for name, text in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", nargs="?", help="one of the commands below")
    parser.add_argument("--version", action="version", version=f"hfa {toolchain_version()}")
    return parser


def _unknown(what: str, name: str, known: Iterable[str], program: str) -> str:
    """Says that an option or a command does not exist, with the one that was probably meant."""
    import difflib

    close = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    return f"unknown {what}" + (f"; did you mean {close[0]}?" if close else f" (see `{program} --help`)")


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
    print("hfa: " + on_one_line(message), file=sys.stderr)
    return code
