"""Lazy import of the public names of a package from its stub."""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import FunctionType

from hfa_support.imports import origins_in

TYPE_CHECKING = False  # known to mypy; importing typing would take 3 ms of `hfa --version`
if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import Any


def refuse_hidden(file: str, packages: Iterable[str]) -> None:
    """Raise ImportError if another file or folder hides a package beside the one of `file`.

    A script's own trim.py or controller.py is found before the installed package of this name.
    """
    installed = _folder_of_package(file)
    for name in packages:
        spec = find_spec(name)
        if spec is not None and spec.origin and _folder_of_package(spec.origin) != installed:
            raise ImportError(
                f"{spec.origin} hides the package {name} that hfa imports; rename this file"
            )


def _folder_of_package(file: str) -> str:
    """Return the folder that contains the package of an `__init__.py`."""
    return os.path.dirname(os.path.dirname(os.path.realpath(file)))


def public_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the functions `__getattr__` and `__dir__` of a package, which import its public names.

    A public name is imported when it is first used. The stub of the package imports all public
    names.

    package: name of the package
    file: `__file__` of the package, with the stub `__init__.pyi` in the same folder
    """
    stub = f"{os.path.splitext(file)[0]}.pyi"

    def get(name: str) -> Any:
        """Return the object with a public name, imported from its module, or the list `__all__`.

        A function is returned with a check of the kinds of its arguments.

        Raises AttributeError if the name is unknown or if a required package is not installed.
        """
        if name == "__all__":
            return installed()
        if name not in origins_in(stub):
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message, name=name, obj=sys.modules[package])
        module_name, name_there = origins_in(stub)[name]
        try:
            module = import_module(module_name, package)
        except ModuleNotFoundError as error:
            if error.name != module_name.partition(".")[0]:
                raise  # the module exists, and what it imports does not
            raise AttributeError(
                f"{package}.{name} requires the package {error.name}; install this package"
            ) from None
        found = getattr(module, name_there) if name_there else module
        return with_checks(found) if isinstance(found, FunctionType | type) else found

    @cache
    def with_checks(found: Any) -> Any:
        """Return a function or class that checks the kinds of its arguments, or of its methods'."""
        from hfa_support.public_arguments import check_methods, checked

        if isinstance(found, FunctionType):
            return checked(found, makers)
        check_methods(found, makers)
        return found

    def makers(kind: str) -> str:
        """Return advice on the public functions that return objects of a class, or ""."""
        offered = [(name, get(name)) for name in installed() if name != kind]
        made = [
            f"{package}.{name}"
            for name, function in offered
            if isinstance(function, FunctionType) and function.__annotations__["return"] == kind
        ]
        trimmed = f'{package}.trim(model, dihedral="7 deg")'
        if kind == "TrimCondition":
            return f"or values by name: {trimmed}"
        example = f": {trimmed}" if kind == "OperatingPoint" else ""
        return f"{kind} is returned by {' and by '.join(made)}{example}" if made else ""

    def installed() -> list[str]:
        """Return the public names that can be imported, because their packages are installed."""
        packages = {
            name: module.partition(".")[0] for name, (module, _) in origins_in(stub).items()
        }
        return [name for name, other in packages.items() if not other or find_spec(other)]

    return get, installed
