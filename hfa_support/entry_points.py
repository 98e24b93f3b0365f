"""Access to the entry points that installed packages declare.

The core does not import these packages.

`importlib.metadata` is imported at the first access, to save time.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from hfa_support.errors import BadInputError, on_one_line

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

#: Group of commands: name, as "prove.schedule" for `hfa prove schedule` -> `CommandEntry`.
COMMANDS = "hfa.commands"
#: Group of aircraft readers: scheme, as "jsbsim" of jsbsim:NAME, or suffix -> (text -> Model).
AIRCRAFT = "hfa.aircraft"
#: Group of critic readers: suffix, as ".abc" -> (path -> CriticFile).
CRITICS = "hfa.critics"


@cache
def offered(group: str, own: tuple[str, ...] = ()) -> dict[str, EntryPoint]:
    """Return the entry points that installed packages declare in a group, name -> entry point.

    The names are sorted.

    own: names in the group that belong to this project

    Raises BadInputError if two packages declare different objects under one name, or a package
    declares one of the own names.
    """
    from importlib.metadata import entry_points

    by_name: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=group), key=lambda entry: entry.name):
        if entry.name in own:
            raise BadInputError(
                f"{package_of(entry)} offers {entry.name}, which belongs to hfa; uninstall the "
                "package"
            )
        other = by_name.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise BadInputError(
                f"{package_of(other)} and {package_of(entry)} both offer {entry.name}; "
                "uninstall one package"
            )
    return by_name


def loaded(entry: EntryPoint) -> Any:
    """Return the object of an entry point, imported from its package.

    Raises BadInputError with the name of the package if the import fails.
    """
    try:
        return entry.load()
    except Exception as error:  # the package may raise any exception
        reason = f"{type(error).__name__}: {on_one_line(str(error))}"
        raise BadInputError(
            f"{package_of(entry)} offers {entry.name}, which cannot be loaded ({reason}); update or"
            " uninstall the package"
        ) from error


def package_of(entry: EntryPoint) -> str:
    """Return "the package NAME" for the package that declares an entry point, for messages."""
    return f"the package {entry.value if entry.dist is None else entry.dist.name}"
