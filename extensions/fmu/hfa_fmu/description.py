"""The `modelDescription.xml` of an FMU: the variables of its model and its interface."""

from __future__ import annotations

import math
import platform
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hfa_aircraft.signals import identifiers
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import xml_root

if TYPE_CHECKING:
    from xml.etree import ElementTree

#: Operating system -> its folder in an FMU of FMI 2.0, its name in FMI 3.0, and the suffix.
_PLATFORMS = {
    "linux": ("linux64", "linux", ".so"),
    "darwin": ("darwin64", "darwin", ".dylib"),
    "win32": ("win64", "windows", ".dll"),
}
_PROCESSORS = {"AMD64": "x86_64", "arm64": "aarch64"}
#: Type of a number -> its lowest and highest value. False is 0 and true is 1.
_RANGES = {
    **dict.fromkeys(("Float64", "Float32"), (-math.inf, math.inf)),
    "Boolean": (0, 1),
    **dict.fromkeys(("Integer", "Enumeration"), (-(2**31), 2**31 - 1)),
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
#: Largest number of states and inputs. A and B are dense, and need a call of the FMU for each.
_MOST_STATES = 1000
#: Largest number of names in a sentence.
_MOST_NAMED = 6


class Variable(NamedTuple):
    """A variable of an FMU.

    reference: value reference, by which FMI calls it
    kind: FMI's type, "Float64" also for the Real of FMI 2.0, or "an array"
    causality, variability: FMI's words, "input" or "parameter", "continuous" or "discrete"
    unit: unit, "" if none is stated
    nominal, start: nominal and start value, 0 if none is stated
    low, high: limits, which may be infinite
    """

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
    def is_whole(self) -> bool:
        """Whether the variable is a whole number: an integer, an enumeration or a truth value."""
        return self.kind in _RANGES and not self.kind.startswith("Float")

    @property
    def is_constant(self) -> bool:
        """Whether the variable is a parameter, or an input of a type that no trim solves for."""
        is_setting = self.causality == "input" and not self.is_real
        return self.kind in _RANGES and (self.causality == "parameter" or is_setting)

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
        derivatives of `states`, and `parameters` are constant, also inputs that are no real numbers
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
        return _read(xml_root(path.read_bytes(), path.name))
    except BadInputError:
        raise
    except (KeyError, ValueError, IndexError, StopIteration) as error:
        raise BadInputError(
            f"modelDescription.xml is not valid ({shortened(str(error))}); export it again"
        ) from error


def library_of(folder: Path, description: Description) -> Path:
    """Return the path of the library for this system. Raises BadInputError if there is none."""
    folder_of_fmi_2, system, suffix = _PLATFORMS.get(sys.platform, ("", "", ""))
    processor = _PROCESSORS.get(platform.machine(), platform.machine())
    here = folder_of_fmi_2 if description.version == 2 else f"{processor}-{system}"
    library = folder / "binaries" / here / f"{description.identifier}{suffix}"
    if not library.is_file():
        found = ", ".join(sorted(platform.name for platform in folder.glob("binaries/*"))) or "none"
        raise BadInputError(
            f"the FMU has no library for this system (found: {found}); export it for {here}"
        )
    return library


def _read(root: ElementTree.Element) -> Description:
    """Return the description in a document."""
    fmi_version = root.get("fmiVersion", "")
    if not fmi_version.startswith(("2.", "3.")):
        raise BadInputError(f"the FMU has FMI {fmi_version}; export it in FMI 2.0 or 3.0")
    version = int(fmi_version[0])
    exchange = root.find("ModelExchange")
    if exchange is None:
        raise BadInputError("the FMU has no model exchange; export it for model exchange")
    provides = exchange.get(f"providesDirectionalDerivative{'s' * (version == 3)}", "false")

    # The states of the model are those whose derivatives the FMU lists.
    variables, state_of = _variables(root, version)
    structure = _structure(root, version, variables)
    states = [state_of[rate] for rate in structure.rates]
    _refuse_states(structure.rates, states, variables)
    inputs = [
        variable
        for variable in variables.values()
        if variable.causality == "input" and variable.is_real
    ]
    if (count := len(states) + len(inputs)) > _MOST_STATES:
        raise BadInputError(
            f"the FMU has {count} states and inputs; export a model with at most {_MOST_STATES}"
        )

    # Parameters and outputs of the model, and all its variables
    constants = [variable for variable in variables.values() if variable.is_constant]
    outputs = [variables[name] for name in structure.outputs if name not in {*states}]
    real_outputs = [variable for variable in outputs if variable.is_real]
    in_model = [*(variables[name] for name in states), *inputs, *constants, *real_outputs]
    names = _names_in_model([variable.name for variable in in_model], states)

    # Variables that the model omits
    settable = [
        variable for variable in variables.values() if variable.causality in ("input", "parameter")
    ]
    left_out = [variable for variable in (*settable, *outputs) if variable.name not in names]
    listed = {*structure.rates, *states}
    unlisted = [
        variables[state] for rate, state in state_of.items() if listed.isdisjoint((rate, state))
    ]

    return Description(
        version=version,
        title=root.get("modelName") or "FMU",
        identifier=exchange.attrib["modelIdentifier"],
        token=root.get("guid" if version == 2 else "instantiationToken", ""),
        has_directional=provides in ("true", "1"),
        indicators=tuple(shortened(name) for name in structure.indicators),
        states=tuple(variables[name] for name in states),
        rates=tuple(variables[name] for name in structure.rates),
        inputs=tuple(inputs),
        parameters=tuple(constants),
        outputs=tuple(real_outputs),
        names=names,
        offered=tuple(_notes_on_variables(in_model, states, names, left_out, unlisted)),
    )


class _Structure(NamedTuple):
    """Names of the derivatives of the states, of the outputs and of the event indicators."""

    rates: list[str]
    outputs: list[str]
    indicators: list[str]


def _structure(
    root: ElementTree.Element, version: int, variables: Mapping[str, Variable]
) -> _Structure:
    """Return what <ModelStructure> lists. Raises BadInputError if it lists no derivatives."""
    if version == 2:
        in_order = list(variables)

        def listed(tag: str) -> list[str]:
            """Return the names of the unknowns in an element, which have numbers from 1 on."""
            unknowns = root.findall(f"ModelStructure/{tag}//Unknown")
            return [in_order[int(unknown.attrib["index"]) - 1] for unknown in unknowns]

        count = int(root.get("numberOfEventIndicators") or 0)
        indicators = [f"event indicator {number}" for number in range(1, count + 1)]
        structure = _Structure(listed("Derivatives"), listed("Outputs"), indicators)
    else:
        name_of = {variable.reference: name for name, variable in variables.items()}

        def referenced(tag: str) -> list[str]:
            """Return the names of the variables to which the elements of a kind refer."""
            elements = root.findall(f"ModelStructure/{tag}")
            return [name_of[int(element.attrib["valueReference"])] for element in elements]

        tags = ("ContinuousStateDerivative", "Output", "EventIndicator")
        structure = _Structure(*map(referenced, tags))
    if not structure.rates:
        raise BadInputError(
            "the FMU has no continuous states; export a model whose equations have der(x)"
        )
    return structure


def _refuse_states(rates: list[str], states: list[str], variables: Mapping[str, Variable]) -> None:
    """Raise BadInputError for a state, or its derivative, that is not a scalar of 64 bits."""
    for name in (*states, *rates):
        if not variables[name].is_real:
            raise BadInputError(
                f"the state {shortened(name)} is {variables[name].kind}; export it with scalars "
                "of 64 bits"
            )


def _notes_on_variables(
    in_model: list[Variable],
    states: list[str],
    names: Mapping[str, str],
    left_out: list[Variable],
    unlisted: list[Variable],
) -> Iterator[str]:
    """Yield notes on variables of the FMU that the model contains, changes or omits.

    in_model: variables of the model, of which `states` are states
    names: name in the FMU -> name in the model
    left_out: variables that the model omits because of their type
    unlisted: states that the model omits because <ModelStructure> omits their derivatives
    """
    constants = [variable for variable in in_model if variable.is_constant]
    inputs = [
        variable for variable in in_model if variable.causality == "input" and variable.is_real
    ]
    groups = {
        "parameters that --hold sets": constants,
        "parameters of whole numbers (1 is true, 0 false)": [
            variable for variable in constants if variable.is_whole
        ],
        "left out: texts, arrays, and outputs that are not real numbers": left_out,
        "inputs that the FMU changes in steps are taken as continuous": [
            variable for variable in inputs if variable.is_discrete
        ],
        "no states, because ModelStructure does not list their derivatives": unlisted,
        "states without a unit, which the sheet of an aircraft requires": [
            variable for variable in in_model if variable.name in states and not variable.unit
        ],
    }
    for text, group in groups.items():
        if group:
            own_names = [names.get(variable.name, variable.name) for variable in group]
            yield f"{text}: {_listed(own_names)}"


def _names_in_model(names: list[str], states: list[str]) -> dict[str, str]:
    """Return name in the FMU -> name in the model."""
    # A part that contains all states is left out: `body.speed` is `speed`, unless that is the name
    # of another variable.
    part = states[0].rpartition(".")[0]
    while part and not all(name.startswith(f"{part}.") for name in states):
        part = part.rpartition(".")[0]
    short_names = [name.removeprefix(f"{part}.") for name in names]
    if len(set(short_names)) < len(names):
        return identifiers(names)
    identifier_of = identifiers(short_names)
    return {name: identifier_of[short] for name, short in zip(names, short_names, strict=True)}


def _variables(
    root: ElementTree.Element, version: int
) -> tuple[dict[str, Variable], dict[str, str]]:
    """Return name -> variable, and name of a derivative -> name of its state."""
    types = {definition.get("name"): definition for definition in root.findall("TypeDefinitions/*")}
    variables: dict[str, Variable] = {}
    key_of_state: dict[str, str] = {}  # derivative -> number or value reference of its state
    for element in root.findall("ModelVariables/*"):
        typed = element if version == 3 else next(iter(element))
        variable = _variable(element, typed, types.get(typed.get("declaredType")), version)
        variables[variable.name] = variable
        if "derivative" in typed.attrib:
            key_of_state[variable.name] = typed.attrib["derivative"]
    if version == 2:
        name_of = {str(number): name for number, name in enumerate(variables, start=1)}
    else:
        name_of = {str(variable.reference): name for name, variable in variables.items()}
    return variables, {rate: name_of[key] for rate, key in key_of_state.items()}


def _variable(
    element: ElementTree.Element,
    typed: ElementTree.Element,
    declared: ElementTree.Element | None,
    version: int,
) -> Variable:
    """Return a variable.

    element: its element
    typed: the element with its type and numbers, in FMI 3.0 `element` itself
    declared: definition of the type that it names, with its default attributes, or None
    """
    enumerated = [] if declared is None else declared.findall(".//Item")
    if declared is not None and version == 2:
        declared = next(iter(declared), None)  # <Real> in <SimpleType> has the attributes
    attributes = {**(declared.attrib if declared is not None else {}), **typed.attrib}
    kind = "an array" if typed.find("Dimension") is not None else typed.tag
    kind = "Float64" if kind == "Real" else kind
    lowest, highest = _RANGES.get(kind, (0, 0))
    if enumerated:
        values = [int(item.attrib["value"]) for item in enumerated]
        lowest, highest = min(values), max(values)
    numbers = attributes if kind in _RANGES else {}  # texts and arrays have other values
    return Variable(
        name=element.attrib["name"],
        reference=int(element.attrib["valueReference"]),
        kind=kind,
        causality=element.get("causality", "local"),
        variability=element.get("variability", "continuous"),
        unit=attributes.get("unit", ""),
        nominal=abs(_number(numbers.get("nominal") or 0)),
        low=_number(numbers.get("min") or lowest),
        high=_number(numbers.get("max") or highest),
        start=_number(numbers.get("start") or 0),
    )


def _number(text: str | float) -> float:
    """Return the number in a text, 1 for "true" and 0 for "false"."""
    return float(text == "true") if text in ("true", "false") else float(text)


def _listed(names: list[str]) -> str:
    """Return the first names, and how many more there are, as text."""
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(shortened(name) for name in names[:_MOST_NAMED]) + more
