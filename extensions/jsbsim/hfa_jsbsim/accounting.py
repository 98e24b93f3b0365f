"""Notes on what is omitted, and refusals of elements and properties that would be overlooked."""

from __future__ import annotations

import re
from collections.abc import Iterator

from hfa_jsbsim.aircraft import Equations
from hfa_jsbsim.catalog import of_component, without_numbers
from hfa_jsbsim.parts import Parts
from hfa_jsbsim.properties import MOTION, SETTING, Note
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import BadInputError, shortened


def of_engine_files(parts: Parts) -> Iterator[str]:
    """Yield sentences on the engine files that may explain missing power."""
    for file in parts.engines:
        own_name = file.engine.attributes.get("name", "")
        name = own_name or file.mount.attributes.get("file", "an engine")
        if file.dry_of:
            empty = f"the file leaves the {file.dry_of} tank of {name} empty"
            yield f"{empty}: unless --hold fills it, the trim is a glide"
        if file.kind == "turbine_engine" and file.has_propeller:
            what = f"{name} is a turbine engine on a propeller"
            yield f"{what}; its thrust is interpreted as power"


#: Element -> elements in it that affect the forces and that no code here reads.
_UNSUPPORTED = {
    "fdm_config": ("planet", "buoyant_forces"),
    "rocket_engine": ("thrust_table",),
    "tank": ("grain_config",),
    "thruster": ("pointing",),
    "turboprop_engine": ("CombustionEfficiency_N1",),
}
#: JSBSim's properties that a file may set, and on which no force in flight depends.
_WITHOUT_FORCE = (
    *("fcs/", "gear/", "ground/", "ic/", "systems/", "simulation/randomseed"),
    *("simulation/jsbsim-debug", "simulation/terminate", "simulation/pause"),
    *("propulsion/active_engine", "propulsion/starter_cmd", "propulsion/engine/starter-norm"),
    *("propulsion/engine/cooling-factor", "propulsion/engine/engtemp-c"),
    *("propulsion/engine/itt-c", "atmosphere/randomseed", "atmosphere/turb-gain"),
    *("atmosphere/turb-rate", "atmosphere/turb-rhythmicity", "atmosphere/turbulence/milspec/"),
    *("propulsion/tank/external-flow-rate-pps", "propulsion/refuel", "propulsion/fuel_"),
    *(
        "simulation/integrator/",
        "position/terrain-elevation",
        "inertia/print-mass-properties",
        "simulation/write-state-file",
    ),
)
#: Its properties of the wind, which are parameters here.
_OF_AIR = re.compile("atmosphere/(wind|gust|turb)-(north|east|down)")
#: Statements of notes.
_HOW_TO_MAKE_STATES = "?filters=states after the aircraft's name makes these states"
_ALWAYS_OMITTED = "these are omitted, also with ?filters=states"
_UNSET_CONSTANT = (
    "nothing in the files sets these constants, which --hold NAME=VALUE does; ?inputs=NAME after "
    "the aircraft's name makes one an input"
)
_SET_TWICE = "set here and by the pilot; earlier components read the pilot's value"
_UNSET_COMMAND = (
    "nothing in the files sets these commands; --free NAME solves for one, --hold NAME=VALUE sets "
    "it"
)
_UNSET_FROZEN = (
    "nothing in the files sets these, and with other values they need what is unsupported"
)
_NO_BURN = "omitted: fuel burn, so tank contents are constant"


def notes_on_omitted(parts: Parts, equations: Equations) -> list[Note]:
    """Return notes for the user on elements that are omitted and on unusual uses of properties.

    Raises BadInputError, with file and line, for a property that affects the forces.
    """
    notes = [*_notes_on_writers(equations), *_notes_on_constants(equations)]
    if any(file.feeds and file.kind != "electric_engine" for file in parts.engines):
        notes.append(Note(_NO_BURN, rank=MOTION))
    for component, what, is_always in equations.properties.left_out.values():
        name = shortened(component.attributes.get("name", ""))
        subject = f"<{component.name}> {name}: {what}"
        statement = _ALWAYS_OMITTED if is_always else _HOW_TO_MAKE_STATES
        notes.append(Note(statement, subject, component.where, MOTION))
    return notes


def _notes_on_constants(equations: Equations) -> list[Note]:
    """Return notes on properties that nothing sets and on which a force or an output depends."""
    properties, used, notes = equations.properties, equations.used_symbols(), []
    for full_name, (symbol, start, where) in properties.constants.items():
        if full_name in properties.frozen:
            notes.append(Note(_UNSET_FROZEN, f"{shortened(full_name)} ({start:g})", where, SETTING))
        if symbol.element_hash() not in used:
            continue
        is_input = equations.constants[full_name] in equations.inputs
        statement = _UNSET_COMMAND if is_input else _UNSET_CONSTANT
        notes.append(Note(statement, f"{shortened(full_name)} ({start:g})", where, SETTING))
    return notes


def refuse_unsupported(element: Element) -> None:
    """Raise BadInputError if an element within one is not read, and affects the forces."""
    for child in element.children:
        refuse_unsupported(child)
        if child.name in _UNSUPPORTED.get(element.name, ()):
            fault = f"<{child.name}> in <{element.name}> affects the forces"
            raise child.error(f"{fault} and is not supported; remove this element")


def _notes_on_writers(equations: Equations) -> Iterator[Note]:
    """Yield notes on commands of the pilot that the files set, too.

    Raises BadInputError if the files set a built-in JSBSim property that cannot be set.
    """
    properties, faults = equations.properties, []
    for name, in_files in equations.set_in_files.items():
        is_read, fault = name in properties.names_read, ""
        if properties.is_read_only(name):
            fault = "is a read-only JSBSim property"
        elif of_component(name):
            fault = "" if is_read else "is a failure or limit of a component, which cannot be set"
        # What this package reads nowhere, JSBSim reads in its own code.
        elif _OF_AIR.match(name) or not (
            is_read or without_numbers(name).startswith(_WITHOUT_FORCE)
        ):
            fault = "moves a force in JSBSim and cannot be set here"
        if fault:
            faults.append(f"{in_files[-1].where}: {shortened(name)} {fault}")
        is_of_pilot = len(properties.writers[name]) > len(in_files)
        if "-cmd-norm" in name and is_of_pilot and is_read:
            yield Note(_SET_TWICE, shortened(name), in_files[-1].where, SETTING)
    if faults:
        raise BadInputError(f"{'; '.join(faults)}; remove what sets this")
