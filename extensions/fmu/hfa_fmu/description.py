"""The `modelDescription.xml` of an FMU: the variables of its model and its interface."""

from __future__ import annotations

import math
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from hfa_aircraft.names import identifiers
from hfa_support.errors import BadInputError, shortened

#: Operating system -> its folder in an FMU of FMI 2.0, its name in FMI 3.0, and the suffix.
_PLATFORMS = {
    "linux": ("linux64", "linux", ".so"),
    "darwin": ("darwin64", "darwin", ".dylib"),
    "win32": ("win64", "windows", ".dll"),
}
_PROCESSORS = {"AMD64": "x86_64", "arm64": "aarch64"}
#: Largest number of names in a sentence.
_MOST_NAMED = 6


class Variable(NamedTuple):
    """A variable of an FMU. `unit` is "" and `start`, `nominal` are 0 if they are not stated."""

    name: str
    reference: int
    kind: str
    causality: str
    variability: str
    unit: str
    nominal: float
    low: float
    high: float
    start: float

    @property
    def is_real(self) -> bool:
        """Whether the variable is a scalar of 64 bits."""
        return self.kind == "Float64"

    @property
    def is_boolean(self) -> bool:
        """Whether the variable is a scalar truth value, 0 or 1."""
        return self.kind == "Boolean"

    @property
    def is_discrete(self) -> bool:
        """Whether the variable changes at events only."""
        return self.variability != "continuous"


class Description(NamedTuple):
    """The interface and the variables of an FMU for model exchange.

    version: 2 or 3
    identifier, token: name of its library, and the GUID or instantiation token
    has_directional: whether it declares directional derivatives
    indicators: names of the event indicators
    states, rates, inputs, parameters, outputs: the variables that a model has; `rates` are the
        derivatives of `states`
    names: name in the FMU -> name in the model, of the states, inputs, parameters and outputs
    offered: sentences on the variables that a model has and does not have
    """

    version: int
    title: str
    identifier: str
    token: str
    has_directional: bool
    indicators: tuple[str, ...]
    states: tuple[Variable, ...]
    rates: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    names: Mapping[str, str]
    offered: tuple[str, ...]


def described(folder: Path) -> Description:
    """Return the description of an unpacked FMU.

    Raises BadInputError if it is no FMU for model exchange in FMI 2.0 or 3.0, or if it has no
    continuous states.
    """
    path = folder / "modelDescription.xml"
    if not path.is_file():
        raise BadInputError("this is not an FMU (it has no modelDescription.xml)")
    try:
        root = ElementTree.parse(path).getroot()
        return _read(root)
    except ElementTree.ParseError as error:
        raise BadInputError(
            f"modelDescription.xml is damaged ({error}); export it again"
        ) from error
    except BadInputError:
        raise
    except (KeyError, ValueError, IndexError, StopIteration) as error:
        raise BadInputError(
            f"modelDescription.xml is not valid ({shortened(str(error))}); export it again"
        ) from error


def library_of(folder: Path, description: Description) -> Path:
    """Return the path of the library for this system. Raises BadInputError if there is none."""
    of_two, system, suffix = _PLATFORMS.get(sys.platform, ("", "", ""))
    processor = _PROCESSORS.get(platform.machine(), platform.machine())
    here = of_two if description.version == 2 else f"{processor}-{system}"
    library = folder / "binaries" / here / f"{description.identifier}{suffix}"
    if not library.is_file():
        found = ", ".join(sorted(each.name for each in folder.glob("binaries/*"))) or "none"
        raise BadInputError(
            f"the FMU has no library for this system (found: {found}); export it for {here}"
        )
    return library


def _read(root: ElementTree.Element) -> Description:
    """Return the description in a document."""
    stated = root.get("fmiVersion", "")
    if not stated.startswith(("2.", "3.")):
        raise BadInputError(f"the FMU has FMI {stated}; export it in FMI 2.0 or 3.0")
    version = int(stated[0])
    exchange = root.find("ModelExchange")
    if exchange is None:
        raise BadInputError("the FMU has no model exchange; export it for model exchange")
    provides = exchange.get(f"providesDirectionalDerivative{'s' * (version == 3)}", "false")
    variables, state_of = _variables(root, version)
    structure = root.find("ModelStructure")
    unknowns = [] if structure is None else list(structure)
    if version == 2:
        listed = {part.tag: part.findall("Unknown") for part in unknowns}
        places = {
            tag: [int(each.attrib["index"]) - 1 for each in entries]
            for tag, entries in listed.items()
        }
        names = list(variables)
        rates = [names[place] for place in places.get("Derivatives", [])]
        outputs = [names[place] for place in places.get("Outputs", [])]
        count = int(root.get("numberOfEventIndicators") or 0)
        indicators = [f"event indicator {number}" for number in range(1, count + 1)]
    else:
        name_of = {each.reference: name for name, each in variables.items()}
        of_tag = {
            tag: [
                name_of[int(each.attrib["valueReference"])] for each in unknowns if each.tag == tag
            ]
            for tag in ("ContinuousStateDerivative", "Output", "EventIndicator")
        }
        rates, outputs, indicators = of_tag.values()
    if not rates:
        raise BadInputError(
            "the FMU has no continuous states; export a model whose equations have der(x)"
        )
    states = [state_of[name] for name in rates]
    for name in (*states, *rates):
        if not variables[name].is_real:
            raise BadInputError(
                f"the state {shortened(name)} is {variables[name].kind}; export it with scalars "
                "of 64 bits"
            )
    of_inputs = [each for each in variables.values() if each.causality == "input"]
    of_parameters = [each for each in variables.values() if each.causality == "parameter"]
    of_outputs = [variables[name] for name in outputs if name not in states]
    numbers = [each for each in of_parameters if each.is_real or each.is_boolean]
    not_real = [each.name for each in (*of_inputs, *of_outputs) if not each.is_real]
    not_real += [each.name for each in of_parameters if each not in numbers]
    real_inputs = [each for each in of_inputs if each.is_real]
    real_outputs = [each for each in of_outputs if each.is_real]
    of_model = [*states, *(each.name for each in (*real_inputs, *numbers, *real_outputs))]
    names_in_model = identifiers(of_model)
    discrete = [names_in_model[each.name] for each in real_inputs if each.is_discrete]
    booleans = [names_in_model[each.name] for each in numbers if each.is_boolean]
    said = (
        ("parameters that --hold sets: {}", [names_in_model[each.name] for each in numbers]),
        ("Boolean parameters, 0 or 1: {}", booleans),
        ("left out: integers, texts, arrays, and inputs and outputs of truth values: {}", not_real),
        ("inputs that the FMU changes in steps are taken as continuous: {}", discrete),
    )
    return Description(
        version,
        root.get("modelName") or "FMU",
        exchange.attrib["modelIdentifier"],
        root.get("guid" if version == 2 else "instantiationToken", ""),
        provides in ("true", "1"),
        tuple(shortened(name) for name in indicators),
        tuple(variables[name] for name in states),
        tuple(variables[name] for name in rates),
        tuple(real_inputs),
        tuple(numbers),
        tuple(real_outputs),
        names_in_model,
        tuple(sentence.format(_listed(names)) for sentence, names in said if names),
    )


def _variables(
    root: ElementTree.Element, version: int
) -> tuple[dict[str, Variable], dict[str, str]]:
    """Return the variables by name, and derivative -> state."""
    types = {each.get("name"): each for each in root.findall("TypeDefinitions/*")}
    variables: dict[str, Variable] = {}
    states: dict[str, str] = {}
    for element in root.findall("ModelVariables/*"):
        real = element if version == 3 else next(iter(element))
        declared = types.get(real.get("declaredType"))
        if declared is not None and version == 2:
            declared = next(iter(declared), None)
        attributes = {**(declared.attrib if declared is not None else {}), **real.attrib}
        is_scalar = real.find("Dimension") is None
        kind = "Float64" if real.tag == "Real" else real.tag
        name, is_number = element.attrib["name"], kind == "Float64" and is_scalar
        if kind == "Boolean" and is_scalar:
            is_true = attributes.get("start", "false") in ("true", "1")
            attributes = {"min": "0", "max": "1", "start": str(int(is_true))}
            is_number = True
        low, high, nominal, start = (
            float(attributes.get(key) or default) if is_number else default
            for key, default in (
                ("min", -math.inf),
                ("max", math.inf),
                ("nominal", 0),
                ("start", 0),
            )
        )
        variables[name] = Variable(
            name,
            int(element.attrib["valueReference"]),
            kind if is_scalar else "an array",
            element.get("causality", "local"),
            element.get("variability", "continuous"),
            attributes.get("unit", ""),
            *(abs(nominal), low, high, start),
        )
        if "derivative" in real.attrib:
            states[name] = real.attrib["derivative"]
    if version == 2:
        names = list(variables)
        return variables, {name: names[int(index) - 1] for name, index in states.items()}
    of_reference = {str(each.reference): name for name, each in variables.items()}
    return variables, {name: of_reference[reference] for name, reference in states.items()}


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(shortened(name) for name in names[:_MOST_NAMED]) + more
