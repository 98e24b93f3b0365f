"""The `Model` of an FMU for model exchange, evaluated by `casadi.DaeBuilder`.

The states, inputs, outputs and tunable parameters of the model are those of the FMU, with the
units, nominal values, limits and start values of its `modelDescription.xml`. A dot or bracket in a
name becomes "_". A trim imposes the start values of the inputs by default, and solves for the
states.

A and B are exact if the FMU provides directional derivatives. Otherwise they are central
differences (`differences.py`), and a note in every report gives their step and error.
"""

from __future__ import annotations

import hashlib
import re
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from multiprocessing.util import get_temp_dir
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import casadi as ca
import numpy as np

from hfa_aircraft.about import About, Source
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_fmu.differences import STEP, differenced, largest_difference, slopes_at
from hfa_support.errors import BadInputError, prefix_errors, shortened
from hfa_support.files import LARGEST, regular_file

#: Operating system -> folders of its libraries in an FMU, of FMI 2.0 and 3.0.
_PLATFORMS = {
    "linux": ("linux64", "x86_64-linux", "aarch64-linux"),
    "darwin": ("darwin64", "x86_64-darwin", "aarch64-darwin"),
    "win32": ("win64", "x86_64-windows"),
}
#: Largest relative difference between the derivatives of an FMU and differences of its rates.
_DOUBTFUL = 1e-3


def read_model(text: str) -> Model:
    """Return the model of an FMU. The compiled code in the FMU is executed.

    text: path of the file

    Raises BadInputError if the file is not an FMU for model exchange in FMI 2.0 or 3.0, if it has
    events, no continuous states, an input that is not a real number, or no library for this system,
    or if its code fails.
    """
    content = regular_file(text).read_bytes()
    with prefix_errors(text):
        folder = _unpacked(Path(text))
        name = _suitable(folder)
        try:
            builder = ca.DaeBuilder("fmu", str(folder))
            return _model(builder, name, Source(text, hashlib.sha256(content).hexdigest()))
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1]
            raise BadInputError(
                f"CasADi, which evaluates FMUs, refuses it ({shortened(reason, 200)}); export it "
                "in another version of FMI (2.0 or 3.0), or without what the reason names"
            ) from error


def _unpacked(path: Path) -> Path:
    """Return a new folder with the files of an FMU, which remains until the process ends."""
    # It is in the temporary folder of this process and of the workers that it starts.
    folder = Path(tempfile.mkdtemp(prefix="fmu-", dir=get_temp_dir()))
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(member.file_size for member in archive.infolist()) > LARGEST:
                raise BadInputError(f"the FMU unpacks to more than {LARGEST >> 20} MiB")
            archive.extractall(folder)
    except (zipfile.BadZipFile, NotImplementedError) as error:
        raise BadInputError(f"this is not an FMU ({error}); give a zip file of FMI") from error
    return folder


def _suitable(folder: Path) -> str:
    """Return the name of the model in an FMU with smooth equations that can be evaluated here.

    Raises BadInputError for any other FMU.
    """
    description = folder / "modelDescription.xml"
    if not description.is_file():
        raise BadInputError("this is not an FMU (it has no modelDescription.xml)")
    try:
        root = ElementTree.parse(description).getroot()
    except ElementTree.ParseError as error:
        raise BadInputError(
            f"modelDescription.xml is damaged ({error}); export it again"
        ) from error
    version = root.get("fmiVersion", "")
    if not version.startswith(("2.", "3.")):
        raise BadInputError(f"the FMU has FMI {version}; export it in FMI 2.0 or 3.0")
    if root.find("ModelExchange") is None:
        raise BadInputError("the FMU has no model exchange; export it for model exchange")
    events = int(root.get("numberOfEventIndicators") or len(root.findall(".//EventIndicator")))
    if events:
        raise BadInputError(
            f"the FMU has events ({events} event indicators), at which its states or equations "
            "jump: a trim and A, B need smooth equations; export the model without events"
        )
    folders = _PLATFORMS.get(sys.platform, ())
    if not any((folder / "binaries" / each).is_dir() for each in folders):
        found = ", ".join(sorted(each.name for each in folder.glob("binaries/*"))) or "none"
        raise BadInputError(
            f"the FMU has no library for this system (found: {found}); export it for "
            f"{' or '.join(folders)}"
        )
    if version.startswith("3."):
        _complete_dependencies(root)
        description.write_bytes(ElementTree.tostring(root))
    return root.get("modelName") or "FMU"


def _complete_dependencies(root: ElementTree.Element) -> None:
    """Let each unknown of FMI 3.0 without `dependencies` depend on all variables, as it means."""
    # CasADi requires the attribute.
    variables = root.findall("ModelVariables/*")
    states = {each.get("derivative") for each in variables}
    known = [
        each.get("valueReference", "")
        for each in variables
        if each.get("valueReference") in states
        or each.get("causality") in ("input", "parameter", "independent")
    ]
    for unknown in root.findall("ModelStructure/*"):
        if "dependencies" not in unknown.attrib:
            unknown.set("dependencies", " ".join(known))


def _model(builder: ca.DaeBuilder, title: str, source: Source) -> Model:
    """Return the model of the variables of an FMU."""
    states, inputs, parameters = builder.x(), builder.u(), builder.p()
    outputs = [name for name in builder.y() if name not in states]
    if not states:
        raise BadInputError(
            "the FMU has no continuous states; export a model whose equations have der(x)"
        )
    for name in inputs:
        if builder.type(name) not in ("Float64", "Real"):
            raise BadInputError(
                f"the input {shortened(name)} is {builder.type(name)}; a real number is required"
            )
    names = _identifiers([*states, *inputs, *parameters, *outputs])
    signals = [
        {names[name]: _signal(builder, name) for name in group}
        for group in (states, inputs, parameters, outputs)
    ]
    nominals = [np.array([each.nominal for each in group.values()]) for group in signals[:3]]
    start = [np.array([each.start for each in group.values()]) for group in signals[:3]]
    function = builder.create("fmu", ["x", "u", "p"], ["ode", "y"])
    function, about = _with_derivatives(builder, function, start, nominals)
    places = [builder.y().index(name) for name in outputs]

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        columns = [ca.vertcat(ca.DM(0, 1), *vector) for vector in (x, u, p)]  # DM of numbers
        rates, seen = function(*columns)
        return (
            dict(zip(signals[0], ca.vertsplit(rates), strict=True)),
            {names[name]: seen[place] for name, place in zip(outputs, places, strict=True)},
        )

    return Model(
        title,
        states=signals[0],
        inputs=signals[1],
        equations=equations,
        parameters=signals[2],
        outputs=signals[3],
        trim={name: signal.start for name, signal in signals[1].items()},
        about=about,
        source=source,
    )


def _with_derivatives(
    builder: ca.DaeBuilder,
    function: ca.Function,
    start: list[np.ndarray],
    nominals: list[np.ndarray],
) -> tuple[ca.Function, About]:
    """Return (x, u, p) -> (rates, outputs) with derivatives, and what reports say about them."""
    # Errors and doubts are relative to the largest entry of a row, at the start values.
    fine, coarse = (differenced(function, nominals, step) for step in (STEP, 2.0 * STEP))
    scales = np.concatenate(nominals)
    slopes = slopes_at(fine, start)
    if builder.provides_directional_derivatives():
        apart = largest_difference(slopes_at(function, start), slopes, scales)
        doubts = (
            (f"the derivatives of the FMU differ from differences of its rates by {apart:.1g}",)
            if apart > _DOUBTFUL
            else ()
        )
        return function, About(
            notes=("A and B: exact, by the FMU",), doubts=doubts, equations="FMU"
        )
    # The error of a step of h is c h^2: a third of the difference between those of h and 2 h.
    error = largest_difference(slopes_at(coarse, start), slopes, scales) / 3.0
    note = (
        f"A and B: central differences, steps {STEP:g} of the nominal values; error about "
        f"{error:.1g} at the start values (the FMU provides no derivatives)"
    )
    return fine, About(notes=(note,), equations="FMU")


def _signal(builder: ca.DaeBuilder, name: str) -> Signal:
    """Return the unit, nominal value, limits and start value of a variable of an FMU."""
    start = float(builder.attribute("start", name))
    start = start if np.isfinite(start) else 0.0
    nominal = abs(float(builder.nominal(name)))
    if nominal in (0.0, 1.0):  # not stated
        nominal = max(1.0, abs(start))
    return Signal(builder.unit(name) or "1", nominal, builder.min(name), builder.max(name), start)


def _identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return name in the FMU -> name in the model, an identifier that no other variable has."""
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W+", "_", name).strip("_") or "variable"
        plain = f"v_{plain}" if plain[0].isdigit() else plain
        while plain in found.values():
            plain += "_"
        found[name] = plain
    return found
