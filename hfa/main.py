"""Run the command given on the command line of `hfa`, and report a failure in one line.

Only the modules of this command are imported.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import os
import shlex
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

from hfa.entry_points import (
    command_of_package,
    commands,
    found_in,
    own_commands,
    words_after,
)
from hfa.exit_codes import BAD_INPUT, DONE, FAILED, INTERRUPTED, TERMINATED
from hfa.options.parser import Parser, options_of, unknown
from hfa_support.errors import BadInputError, NoSolutionError, on_one_line, shortened
from hfa_support.progress import drop, print_notes, print_to_stderr

if TYPE_CHECKING:
    from hfa.options.command import Command, Request

    #: Function: words -> (command, program name, option words).
    Find = Callable[[list[str]], tuple[Command, str, list[str]]]

#: Exceptions caused by the user's input or system, reported in one line. Any other is a bug.
FAILURES = (BadInputError, NoSolutionError, OverflowError, UnicodeError, MemoryError, OSError)
#: Largest number of printed warnings from numerical libraries.
_MOST_NOTES = 5
#: Warnings that do not concern a result.
_FOR_PROGRAMMERS = (DeprecationWarning, PendingDeprecationWarning, FutureWarning)


def main(argv: Sequence[str] | None = None, find: Find | None = None) -> int:
    """Run one command and return its exit code. Errors are printed in one line, and warnings as
    notes.

    - 0: the command succeeded.
    - 1: a check failed or no solution exists.
    - 2: the usage or the input is invalid.
    - 130: the run was interrupted by Ctrl-C; 143: it was terminated.

    argv: command line without the program name, or None for the command line of this process
    find: function that returns the command, or None for that named first in the command line
    """
    words = list(sys.argv[1:] if argv is None else argv)
    # Threads slow down operations on matrices of six rows. This must be set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal without "±" prints "?"
    if sys.stdout is None:
        print_to_stderr("hfa: standard output is closed; redirect it, for example to /dev/null")
        return BAD_INPUT
    code = DONE
    with warnings.catch_warnings(record=True) as caught:
        # Warnings of the project are notes, regardless of PYTHONWARNINGS.
        warnings.simplefilter("always", UserWarning)
        try:
            code = _run(words, find or _named_command)
            if sys.stdout is not None:
                sys.stdout.flush()  # a failure is reported below
        except BrokenPipeError:  # when --help or buffered text is written
            drop(sys.stdout)
            return code
        except (*FAILURES, KeyboardInterrupt) as error:
            message, code = _failure(error)
            if isinstance(error, OSError):
                drop(sys.stdout)
            print_to_stderr("hfa: " + on_one_line(message))
            return code
    if caught and not {"-q", "--quiet"} & set(words):
        _print_warnings(caught)
    return code


def _failure(error: BaseException) -> tuple[str, int]:
    """Return the error message and the exit code for an exception."""
    match error:
        case NoSolutionError():
            return str(error), FAILED
        case KeyboardInterrupt():
            return ("terminated", TERMINATED) if error.args else ("interrupted", INTERRUPTED)
        case OverflowError():
            return (
                "a number is too large or too small to compute with; check the options",
                BAD_INPUT,
            )
        case UnicodeError():
            return (
                "a name contains an incomplete character; choose another name",
                BAD_INPUT,
            )
        case MemoryError():
            return "not enough memory; request fewer points or a shorter flight", BAD_INPUT
        case OSError(filename=None):
            return f"cannot write the output: {error.strerror or error}", BAD_INPUT
        case OSError():
            return f"{error.filename}: {error.strerror}; choose another path", BAD_INPUT
    return str(error), BAD_INPUT


def _run(words: list[str], find: Find) -> int:
    """Run the command given by the command line, and return its exit code.

    find: function words -> (command, program name, option words)
    """
    from hfa_support.files import inputs_kept

    with contextlib.ExitStack() as around:
        around.enter_context(inputs_kept())  # no output may overwrite a file that is read
        try:
            command, program, options = find(words)
            values = parser_of(command, program).parse_words(options)
        except SystemExit:
            return DONE  # argparse exits after --help
        from hfa_support.provenance import now

        line = shlex.join([*program.split(), *options])
        request: Request = command.request(**values, line=line, date=now())
        if request.quiet:
            around.enter_context(contextlib.redirect_stderr(io.StringIO()))
        try:
            return _computed(command, request)
        except BadInputError as error:
            # `error.options` is an option with its value that supplies what is missing, such as
            # ("--set", "mass=10"). It is proposed in the message, if the command has the option.
            names = [declared.names for declared in options_of(command.request).values()]
            if not error.options or error.options[0] not in chain(*names):
                raise
            supplied = shlex.join([*program.split(), *_with_option(options, error.options)])
            raise BadInputError(f"{error}; type {supplied}") from error
        except SystemExit as error:
            raise BadInputError(
                "the equations of the aircraft call sys.exit; raise a ValueError instead"
            ) from error
        except ModuleNotFoundError as error:
            if not command.install:
                raise
            raise BadInputError(
                f"{program} requires the module {error.name}; type python -m pip install "
                f"{' '.join(command.install)}"
            ) from error


def _computed(command: Command, request: Request) -> int:
    """Run a command, show its outcome and return the exit code."""
    from hfa.options.command import show, show_text
    from hfa_support.files import refuse_read

    paths = [path for path in (request.output, request.picture) if path is not None]
    for path in paths:
        refuse_read(path)
    if len({os.path.realpath(path) for path in paths}) < len(paths):
        raise BadInputError(f"{paths[0]} is given for two outputs; give two different files")
    try:
        given = () if command.given is None else (command.given(request),)
        outcome = command.run(request, *given)
        show(request, outcome)
    except NoSolutionError as error:
        if request.json and error.found is not None:  # by a failed search
            show_text(request, error.found, error.source)
        raise
    return DONE if outcome.ok else FAILED


def _with_option(words: list[str], option: tuple[str, ...]) -> list[str]:
    """Return a command line with an option and its value, in place of another value of the option.

    option: name and value
    """
    name = option[0]
    kept = list(words)
    if name in kept and name != "--set":  # --set is repeatable
        place = kept.index(name)
        del kept[place : place + 2]
    return [*kept, *option]


def _print_warnings(caught: Iterable[warnings.WarningMessage]) -> None:
    """Print the warnings of a successful run as notes, each distinct text once."""
    notes: list[str] = []
    of_libraries: list[str] = []
    for warning in caught:
        if warning.category is UserWarning:
            notes.append(str(warning.message))
        elif not issubclass(warning.category, _FOR_PROGRAMMERS):
            of_libraries.append(f"while computing: {warning.message}; check the result")
    print_notes((*dict.fromkeys(notes), *list(dict.fromkeys(of_libraries))[:_MOST_NOTES]))


def _named_command(words: list[str]) -> tuple[Command, str, list[str]]:
    """Return the command in a command line, its name for messages, and the remaining words."""
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    name, options = found_in(words)
    if name:
        entry = own_commands().get(name) or command_of_package(name)
        return entry.load(), f"hfa {name}", options
    from hfa.overview import overview

    first = words[0] if words else "--help"
    overview().parse_words([first])  # ends at --help and --version, raises for another option
    raise BadInputError(unknown(f"command {shortened(first)!r}", first.lower(), commands(), "hfa"))


def parser_of(command: Command, program: str) -> Parser:
    """Return the parser of the options of a command, with its help text.

    program: what the user types before the options: "hfa trim", or "python my_command.py"
    """
    called, _, name = program.partition(" ")
    # Only `hfa` has commands of two words; a program of the user is a single command.
    second_words = partial(words_after, name) if called == "hfa" else dict
    return Parser(
        options_of(command.request),
        example=command.example,
        second_words=second_words,
        prog=program,
        description=inspect.cleandoc(command.run.__doc__ or ""),
    )
