"""The table of all commands of this distribution, and the lookup of a command by name.

Other packages add commands by entry points.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

from hfa_support.entry_points import COMMANDS as GROUP, loaded, offered, package_of
from hfa_support.errors import BadInputError, choice_of, shortened, warn

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from hfa.options.command import Command


class CommandEntry(NamedTuple):
    """Entry point of a command, listed in `hfa --help` without loading the command's module.

    group: heading in the help, an existing or a new one
    about: summary of the command in one line
    command: location of its `Command`, "package.module:name"
    example: last line of the command's help
    install: optional packages that the command requires, as pip names them
    """

    group: str
    about: str
    command: str
    example: str = ""
    install: tuple[str, ...] = ()

    def load(self) -> Command:
        """Return the command, imported from its module, with the example and install text of the
        entry.

        Raises BadInputError if the object is not a `Command`.
        """
        module, _, name = self.command.partition(":")
        from hfa.options.command import Command

        found = getattr(import_module(module), name)
        if not isinstance(found, Command):
            raise BadInputError(
                f"{self.command} is not a command; write @command(OPTIONS) above the function, "
                "where OPTIONS is a dataclass that extends hfa.extend.Request"
            )
        return found._replace(install=self.install, example=self.example)


#: The commands of this distribution in the order of the help, each with the module that is loaded
#: on use.
COMMANDS = {
    "trim": CommandEntry(
        "use",
        "trim an aircraft; report variables, limits, loads, performance",
        "hfa.commands.trim:trim",
        example="hfa trim --dihedral 10",
    ),
    "linearize": CommandEntry(
        "use",
        "compute the exact A and B at a trim, modes and handling qualities",
        "hfa.commands.linearize:linearize",
        example="hfa linearize --dihedral 10 -o model.mat",
    ),
    "sweep": CommandEntry(
        "model",
        "trim and linearize over a grid, and track the modes",
        "hfa.commands.sweep:sweep",
        example="hfa sweep --dihedral 0:20:5 -o sweep.csv",
    ),
    "regenerate": CommandEntry(
        "model",
        "compare both printed pairs (A, B) entry by entry",
        "hfa.commands.regenerate:regenerate",
        example="hfa regenerate -o pairs.html",
    ),
    "solve": CommandEntry(
        "critic",
        "solve a zero-sum game or LQR exactly, with a certificate",
        "hfa.commands.game:solve",
        example="hfa solve --dihedral 15 --delta 300",
    ),
    "learn": CommandEntry(
        "critic",
        "learn the value and gain of the game",
        "hfa.commands.game:learn",
        example="hfa learn --dihedral 15 -o learned.npz",
    ),
    "verify": CommandEntry(
        "use",
        "compare a learned critic with the exact game solution",
        "hfa.commands.verify:verify",
        example="hfa verify --dihedral 15 --weights learned.npz",
    ),
    "assess": CommandEntry(
        "critic",
        "assess an RL policy or gain as deployed: sampled, delayed",
        "hfa_flight.commands.assess:assess",
        example="hfa assess examples/gtm_policy/late.toml --aircraft examples/gtm.py:GTM",
    ),
    "fly": CommandEntry(
        "flight",
        "simulate a policy, or none, in turbulence, gusts and noise",
        "hfa_flight.commands.fly:fly",
        example="hfa fly --dihedral 15 --gust 400:5",
    ),
    "identify": CommandEntry(
        "model",
        "identify parameters from flight records, with 95 % bands",
        "hfa_identify.commands.identify:identify",
        example="hfa identify examples/uav_record.csv --aircraft examples/uav.toml --free Cm_q",
    ),
    "optimize": CommandEntry(
        "flight",
        "search for the best flight, and compare policies with it",
        "hfa_flight.commands.optimize:optimize",
        example="hfa optimize --dihedral 15 --initial speed=5,alpha=2.865",
    ),
    "export": CommandEntry(
        "flight",
        "write the aircraft for other tools: C source, FMU, MATLAB",
        "hfa_flight.commands.export:export",
        example="hfa export --dihedral 15 -o folder",
    ),
    "prove": CommandEntry(
        "proof",
        "prove a schedule, or --check a certificate",
        "hfa_prove.commands.check:prove",
        example="hfa prove --check certificate.json",
    ),
    "prove schedule": CommandEntry(
        "proof",
        "stability of a gain schedule at every point of an interval",
        "hfa_prove.commands.schedule:schedule",
        example="hfa prove schedule --dihedral 14:14.5 -o certificate.json",
    ),
}

#: First words of the commands with two words, "prove".
_FIRST_WORDS = {name.partition(" ")[0] for name in COMMANDS if " " in name}


@cache
def own_commands() -> dict[str, CommandEntry]:
    """Return the commands of this distribution whose package is installed, name -> entry.

    A name has one or two words, for example "prove schedule".
    """
    return {
        name: entry
        for name, entry in COMMANDS.items()
        if find_spec(entry.command.partition(".")[0]) is not None
    }


def commands() -> dict[str, CommandEntry]:
    """Return the commands of this distribution and of other packages, name -> entry.

    A command of another package that cannot be loaded, or whose name is taken, is left out with a
    warning.
    """
    entries = dict(own_commands())
    for name, offer in _of_others().items():
        try:
            if name in entries:
                raise BadInputError(
                    f"{package_of(offer)} declares `hfa {name}`, a command of hfa; uninstall the "
                    "package"
                )
            entries[name] = command_of_package(name)
        except BadInputError as error:
            warn(str(error))
    return entries


def command_of_package(name: str) -> CommandEntry:
    """Return the entry of an existing command that another package declares.

    Raises BadInputError if the entry point of the package is not a CommandEntry.
    """
    offer = _of_others()[name]
    entry = loaded(offer)
    if not isinstance(entry, CommandEntry):
        raise BadInputError(
            f"{offer.value}, declared for `hfa {name}`, is not a CommandEntry; correct the package"
        )
    return entry


def _of_others() -> dict[str, EntryPoint]:
    """Return the entry points of commands of other packages by the name of the command."""
    return {name.replace(".", " "): offer for name, offer in offered(GROUP).items()}


def words_after(name: str) -> Mapping[str, str]:
    """Return the possible second words of commands with two words, second word -> summary.

    name: first word, for example "prove"
    """
    if name in own_commands() and name not in _FIRST_WORDS:
        return {}  # a command of one word: other packages are not searched
    first = f"{name} "
    return {
        both_words.removeprefix(first): entry.about
        for both_words, entry in commands().items()
        if both_words.startswith(first)
    }


def found_in(words: list[str]) -> tuple[str, list[str]]:
    """Return the name of the command in a command line, and the remaining words.

    The name is "" if the first word is not a command.

    words: command line without the program name

    Raises BadInputError if a second word of the name is missing or unknown, if an option comes
    before or between the words of the name, or if the words are quoted together.
    """
    first = words[0] if words else ""
    if " " in first:
        raise BadInputError(f"{shortened(first)!r} is one argument; type its words without quotes")
    # Most commands have one word: the packages of others are not searched for second words.
    if first in own_commands() and first not in _FIRST_WORDS:
        return first, words[1:]
    names = {*own_commands(), *_of_others()}
    two_words = " ".join(words[:2])
    if len(words) > 1 and two_words in names:  # prove schedule ...
        return two_words, words[2:]
    separated = [f"{first} {word}" for word in words[2:] if f"{first} {word}" in names]
    if separated and words[1].startswith("-"):  # prove -q schedule
        raise BadInputError(
            f"give both words of the command first: hfa {separated[0]} {shortened(words[1])} ..."
        )
    second_words = words_after(first)
    if second_words and len(words) > 1 and not words[1].startswith("-"):  # prove schedules
        what = f"unknown word {shortened(words[1])!r} after `hfa {first}`"
        raise BadInputError(f"{what}; {choice_of(words[1].lower(), second_words)}")
    if first in names:
        return first, words[1:]
    if second_words:  # prove
        choices = ", ".join(second_words)
        raise BadInputError(f"`hfa {first}` requires a second word; choose from {choices}")
    commands_behind = [word for word in words if word in names]
    if first.startswith("-") and commands_behind:  # -q trim
        raise BadInputError(
            "an option is given before the command; write "
            f"hfa {commands_behind[0]} {shortened(first)} ..."
        )
    return "", words
