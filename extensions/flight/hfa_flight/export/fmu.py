"""Export of an aircraft, with or without a policy, as an FMU: library, sources and description.

The format is FMI 2.0, because more tools import FMI 2.0 than FMI 3.0.
"""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as xml

import casadi as ca

from hfa_flight.export.c_text import braced, comment_lines
from hfa_flight.export.exported_loop import LONGEST_STEP, ExportedLoop
from hfa_support.errors import NoSolutionError
from hfa_support.files import written_whole
from hfa_support.native.c_code import c_function
from hfa_support.native.row_code import c_compiler
from hfa_support.provenance import Provenance
from hfa_support.reporting.results import json_text

#: Name of the model and of its library.
IDENTIFIER = "hfa_aircraft"
#: C sources in the FMU: the loop, the functions of FMI, which are the same for all aircraft, and
#: sizes and initial values.
SOURCE = "aircraft_loop.c"
WRAPPER = "fmi2_aircraft.c"
SETTINGS = "fmu_settings.h"
#: Folder and suffix of the library in the FMU, by platform.
_FOLDERS = {"linux": ("linux64", "so"), "darwin": ("darwin64", "dylib"), "win32": ("win64", "dll")}
#: Unit -> exponents of base units, factor.
_BASE = {
    "1": {},
    "deg": {"rad": "1", "factor": repr(math.pi / 180)},
    "rad": {"rad": "1"},
    "rad/s": {"rad": "1", "s": "-1"},
    "rad/s^2": {"rad": "1", "s": "-2"},
    "ft": {"m": "1", "factor": "0.3048"},
    "ft/s": {"m": "1", "s": "-1", "factor": "0.3048"},
    "ft/s^2": {"m": "1", "s": "-2", "factor": "0.3048"},
}

#: Earliest date that a ZIP archive can store.
_FIRST_DATE = (1980, 1, 1, 0, 0, 0)


def write_fmu(loop: ExportedLoop, path: Path, origin: Provenance) -> None:
    """Write a loop as an FMU. If an error occurs, no file is written.

    origin: provenance, stored in the FMU

    Raises NoSolutionError if no C compiler is found or the compiler fails.
    """
    compiler = c_compiler()
    if compiler is None:
        raise NoSolutionError(
            "an FMU requires a C compiler, but none was found; install gcc or clang, or set the "
            "environment variable CC to a compiler"
        )
    sources = {
        SOURCE: _source(loop, origin),
        WRAPPER: files(__package__).joinpath(WRAPPER).read_text("utf-8"),
    }
    # The settings contain the identifier, so it identifies the other sources.
    guid = hashlib.sha256("".join(sources.values()).encode()).hexdigest()[:32]
    sources[SETTINGS] = _settings(loop, guid)
    folder, suffix = _FOLDERS.get(sys.platform, _FOLDERS["linux"])
    content: dict[str, str | bytes] = {
        "modelDescription.xml": description(loop, origin, guid),
        f"binaries/{folder}/{IDENTIFIER}.{suffix}": _library(compiler, sources),
        "resources/provenance.json": json_text(origin.to_dict()),
        **{f"sources/{name}": text for name, text in sources.items()},
    }
    date = max(datetime.fromisoformat(origin.date).timetuple()[:6], _FIRST_DATE)
    with written_whole(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, data in content.items():
            archive.writestr(zipfile.ZipInfo(name, date), data, zipfile.ZIP_DEFLATED)


def _source(loop: ExportedLoop, origin: Provenance) -> str:
    """Return the C source of a function `fmu_loop` that evaluates the loop."""
    results = ("dy", "u") if loop.outputs else ("dy",)  # C has no arrays without entries
    y_and_v = [ca.SX.sym("y", len(loop.states)), ca.SX.sym("v", loop.function.numel_in(1))]
    function = ca.Function("loop", y_and_v, loop.function.call(y_and_v)[: len(results)])
    unused = "" if loop.outputs else "\n    (void)u;"
    call = f"    loop({', '.join(('y', 'v', *results))});{unused}"
    return (
        f'/* {comment_lines(_heading(origin))} */\n#include "{SETTINGS}"\n\n#include <math.h>\n\n'
        f"{c_function(function, 'loop', ('y', 'v'), results)}\n"
        f"void fmu_loop(const double *y, const double *v, double *dy, double *u)\n{{\n{call}\n}}\n"
        + _sample_source(loop)
    )


def _sample_source(loop: ExportedLoop) -> str:
    """Return the C source of a function `fmu_sample` that computes a sampled policy, or nothing."""
    if loop.sampled is None:
        return ""
    sample = c_function(loop.sampled.function, "sample", ("y", "v", "memory"), ("u", "later"))
    return (
        f"\n{sample}\n"
        "void fmu_sample(const double *y, const double *v, double *memory, double *u)\n{\n"
        "    double later[FMU_MEMORY];\n"
        "    sample(y, v, memory, u, later);\n"
        "    for (int i = 0; i < FMU_MEMORY; i++) memory[i] = later[i];\n}\n"
    )


def _settings(loop: ExportedLoop, guid: str) -> str:
    """Return the C header with the sizes and initial values of a loop for the wrapper."""
    defined = {
        "GUID": f'"{guid}"',
        "LONGEST_STEP": repr(LONGEST_STEP),
        "STATES": len(loop.states),
        "OUTPUTS": len(loop.outputs),
        "INPUTS": len(loop.inputs),
        "STATE_STARTS": braced([state.start for state in loop.states]),
        "INPUT_STARTS": braced([signal.start for signal in loop.inputs]),
        "NOMINALS": braced([state.size for state in loop.states]),
        # held commands and memory of a sampled policy
        "HELD": 0,
        "MEMORY": 0,
    }
    sampled = loop.sampled
    if sampled is not None:
        defined |= {
            "HELD": len(sampled.starts),
            "HELD_STARTS": braced(list(sampled.starts)),
            "MEMORY": sampled.function.numel_in(2),
            "SAMPLE": repr(sampled.dt),
        }
    lines = [f"#define FMU_{name} {value}" for name, value in defined.items()]
    lines += ["", "/* Rates of the states y and the outputs u under the inputs v. */"]
    lines += ["void fmu_loop(const double *y, const double *v, double *dy, double *u);"]
    if sampled is not None:
        lines += ["", "/* Commands u of a sample, and its memory. */"]
        lines += ["void fmu_sample(const double *y, const double *v, double *memory, double *u);"]
    return "\n".join([*lines, ""])


def _heading(origin: Provenance) -> str:
    """Return the provenance and the command as text, for comments."""
    return f"{origin.text()}\n{origin.command}"


def description(loop: ExportedLoop, origin: Provenance, guid: str) -> str:
    """Return the text of modelDescription.xml.

    The variables are the states, their rates, the outputs of the loop, and its inputs. The outputs
    of the FMU are the aircraft states and the outputs of the loop. A sampled policy is simulated in
    co-simulation alone.

    origin: provenance
    guid: identifier of the FMU
    """
    root = xml.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=IDENTIFIER,
        guid=guid,
        description="; ".join(_heading(origin).splitlines()),
        version=origin.version,
        generationTool=f"hfa-toolchain {origin.version}",
        generationDateAndTime=origin.date,
        numberOfEventIndicators="0",
    )
    # Kinds of simulation.
    for kind in ("ModelExchange", "CoSimulation") if loop.sampled is None else ("CoSimulation",):
        able = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
        able |= {"canHandleVariableCommunicationStepSize": "true"} if kind == "CoSimulation" else {}
        described = xml.SubElement(root, kind, able, modelIdentifier=IDENTIFIER)
        sources = xml.SubElement(described, "SourceFiles")
        for name in (SOURCE, WRAPPER):
            xml.SubElement(sources, "File", name=name)

    # Elements in the order of the standard; units are those of the variables.
    units = xml.SubElement(root, "UnitDefinitions")
    xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="60", stepSize="0.01")
    listed_variables = xml.SubElement(root, "ModelVariables")
    structure = xml.SubElement(root, "ModelStructure")
    outputs = xml.SubElement(structure, "Outputs")
    derivatives = xml.SubElement(structure, "Derivatives")
    computed = xml.SubElement(structure, "InitialUnknowns")
    variables = _variables(loop)

    # References to variables count from 0, and their indices in the structure from 1.
    for number, variable in enumerate(variables):
        _add_variable(listed_variables, number, variable)
        index = str(number + 1)
        if variable.causality == "output":
            xml.SubElement(outputs, "Unknown", index=index)
        if variable.rate_of:
            xml.SubElement(derivatives, "Unknown", index=index)
        if variable.start is None:
            xml.SubElement(computed, "Unknown", index=index)

    for unit in dict.fromkeys(variable.unit for variable in variables):
        defined = xml.SubElement(units, "Unit", name=unit)
        if unit in _BASE:
            xml.SubElement(defined, "BaseUnit", _BASE[unit])
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, "unicode") + "\n"


class _Variable(NamedTuple):
    """Variable of an FMU.

    causality: "output", "local" or "input"
    start: initial value, or None if it is computed
    rate_of: number of the state of which it is the rate, from 1, or 0
    """

    name: str
    unit: str
    causality: str
    start: float | None = None
    rate_of: int = 0


def _variables(loop: ExportedLoop) -> list[_Variable]:
    """Return the states of a loop, which are outputs, their rates, its outputs and its inputs."""
    return [
        *(_Variable(y.name, y.unit, "output", y.start) for y in loop.states),
        *(
            _Variable(f"der({y.name})", y.rate_unit, "local", rate_of=number)
            for number, y in enumerate(loop.states, start=1)
        ),
        *(_Variable(h.name, h.unit, "output") for h in loop.outputs),
        *(_Variable(v.name, v.unit, "input", v.start) for v in loop.inputs),
    ]


def _add_variable(listed: xml.Element, number: int, variable: _Variable) -> None:
    """Add a variable to the element ModelVariables."""
    about = {
        "name": variable.name,
        "valueReference": str(number),
        "causality": variable.causality,
        "variability": "continuous",
    }
    if variable.causality != "input":
        about["initial"] = "calculated" if variable.start is None else "exact"
    real = {"unit": variable.unit}
    if variable.start is not None:
        real["start"] = repr(float(variable.start))
    if variable.rate_of:
        real["derivative"] = str(variable.rate_of)
    xml.SubElement(xml.SubElement(listed, "ScalarVariable", about), "Real", real)


def _library(compiler: str, sources: Mapping[str, str]) -> bytes:
    """Compile C sources and return the content of the shared library."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        options = ["-std=c99", "-O2", "-fPIC", "-shared"]
        words = [compiler, *options, SOURCE, WRAPPER, "-o", "library", "-lm"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            messages = done.stderr.strip().splitlines() or ["no message"]
            raise NoSolutionError(
                f"{compiler} cannot compile the FMU ({messages[0]}); set the environment variable "
                "CC to another compiler"
            )
        return (folder / "library").read_bytes()
