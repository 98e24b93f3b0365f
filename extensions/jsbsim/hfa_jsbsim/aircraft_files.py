"""Files of JSBSim aircraft: where they are, and the options behind their name."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any

from hfa_jsbsim.parts import Choices
from hfa_jsbsim.properties import canonical
from hfa_jsbsim.xml_file import Folders
from hfa_support.errors import BadInputError, choice_of, shortened
from hfa_support.files import resolved

#: Options after the question mark: field of `Choices` -> its only value, which makes it True.
_CHOICES = {"filters": "states", "engines": "states", "throttles": "each"}


def choices_of(text: str) -> Choices:
    """Return the options in the text after a question mark."""
    made: dict[str, Any] = {}
    for word in text.split("&") if text else []:
        name, _, value = word.partition("=")
        if name == "inputs" and value:
            made[name] = tuple(dict.fromkeys(map(canonical, value.split(","))))
        elif name == "folder" and value:
            made[name] = value
        elif _CHOICES.get(name) == value:
            made[name] = True
        else:
            known = ", ".join(f"{key}={only}" for key, only in _CHOICES.items())
            known += ", inputs=PROPERTY,PROPERTY or folder=FOLDER"
            raise BadInputError(
                f"{shortened(word)} is not an option of a JSBSim aircraft; use {known}"
            )
    return Choices(**made)


def find_aircraft(text: str, folder: str) -> tuple[Path, Folders]:
    """Return the path of an aircraft's file, and the folders of further files.

    folder: folder of the aircraft's other files, "" for that of its file
    """
    root = data_folder()
    if text.startswith("jsbsim:"):
        path = _in_data(text.removeprefix("jsbsim:"), root)
    else:
        path = resolved(text)
    data = None if root is None else resolved(root)
    own = resolved(folder) if folder else path.parent
    shared = [own.parent.parent]  # of ROOT/aircraft/NAME/NAME.xml
    if data is not None and data not in shared:
        shared.append(data)
    return path, Folders(own, tuple(shared), data)


def _in_data(name: str, root: Path | None) -> Path:
    """Return the path of the file of an aircraft that is included with JSBSim."""
    if root is None:
        raise BadInputError(
            f"jsbsim:{shortened(name)}: JSBSim is not installed; type"
            " python -m pip install jsbsim, or set"
            " JSBSIM_ROOT to the folder that contains aircraft, engine and systems"
        )
    folders = sorted(folder.name for folder in (root / "aircraft").iterdir() if folder.is_dir())
    if name not in folders:
        raise BadInputError(
            f"JSBSim has no aircraft {shortened(name)!r}; {choice_of(name, folders)}"
        )
    return resolved(root / "aircraft" / name / f"{name}.xml")


def data_folder() -> Path | None:
    """Return the folder of JSBSim's data, or None.

    The folder contains `aircraft`, `engine` and `systems`. It is $JSBSIM_ROOT, else the folder of
    the installed package jsbsim. The package is not imported. Without both the result is None.

    Raises BadInputError if $JSBSIM_ROOT contains no folder `aircraft`.
    """
    root = os.environ.get("JSBSIM_ROOT")
    if root:
        if not (Path(root) / "aircraft").is_dir():
            raise BadInputError(
                f"JSBSIM_ROOT is {shortened(root)}, which contains no folder named aircraft; set "
                "JSBSIM_ROOT to JSBSim's data folder"
            )
        return Path(root)
    package = importlib.util.find_spec("jsbsim")
    if package is None or not package.submodule_search_locations:
        return None
    return Path(next(iter(package.submodule_search_locations)))
