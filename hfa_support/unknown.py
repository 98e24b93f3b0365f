"""Resolution of unknown attributes, arguments and public names.

Installed packages may supply them. Otherwise an error suggests the nearest known names.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from typing import Any

from hfa_support.entry_points import PARTS, offered, part
from hfa_support.errors import BadInputError, advice


def attribute_of(value: Any, name: str, *more: str) -> Any:
    """Return an attribute that an installed package adds to a result.

    more: further attributes for the message

    Raises AttributeError, which suggests the nearest attributes, where no package adds it.
    """
    if "notebook.attribute" in offered(PARTS):
        return part(PARTS, "notebook.attribute", "")(value, name, *more)
    raise no_attribute(value, name, *more)


def no_attribute(value: object, name: str, *more: str) -> AttributeError:
    """Return the AttributeError of an unknown attribute, with the nearest attributes.

    An error inside a property of that name is raised itself.

    more: further attributes
    """
    if hasattr(type(value), name):
        object.__getattribute__(value, name)
    known = [each for each in (*dir(value), *more) if each[0] != "_"]
    return AttributeError(f"{type(value).__name__} has no attribute {name!r}{advice(name, known)}")


def keywords_meant(
    function: Callable[..., Any], name: str, arguments: tuple[Any, ...], named: dict[str, Any]
) -> dict[str, Any] | None:
    """Return the keywords of a failed call as an installed package reads them.

    The result is None where the arguments fit, so that the call failed for another reason. Raises
    BadInputError where an argument is missing, unknown or superfluous.

    name: name of the function in messages
    """
    signature = inspect.signature(function)
    try:
        signature.bind(*arguments, **named)
    except TypeError as wrong:
        known = [each for each in signature.parameters if each != "self"]
        if "notebook.keywords" in offered(PARTS):
            meant: dict[str, Any] = part(PARTS, "notebook.keywords", "")(known, named)
            if meant.keys() != named.keys():
                return meant
        near = next((advice(word, known) for word in named if word not in known), "")
        raise BadInputError(
            f"{name}: {wrong}{near}; its arguments are {', '.join(known)}"
        ) from None
    return None


def no_public_name(
    package: str, name: str, get: Callable[[str], Any], known: Iterable[str]
) -> AttributeError:
    """Return the AttributeError of an unknown public name.

    It suggests the nearest names. Without a near name it lists the classes that have an attribute
    of this name.

    get: returns the object of a public name
    known: the public names
    """
    is_module = find_spec(f"{package}.{name}") is not None  # Python imports it after this error
    near = advice(name, known)
    if not near and not is_module:
        classes = [each for each in known if each[0].isupper() and hasattr(get(each), name)]
        near = f"; it is an attribute of {', '.join(classes[:3])}" if classes else ""
    return AttributeError(f"module {package!r} has no attribute {name!r}{near}")
