"""Content of the files of a JSBSim aircraft, before the equations are built."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hfa_jsbsim.airframe import (
    mass_in_file,
    read_empty,
    read_metrics,
    read_point_mass,
    read_tanks,
)
from hfa_jsbsim.engines import EngineFile, read_engine
from hfa_jsbsim.xml_file import Element, Folders
from hfa_support.errors import BadInputError, shortened

#: Sections of the control system, in JSBSim's order of loading and evaluation.
SYSTEMS = ("system", "autopilot", "flight_control")
#: Sections that are read, in JSBSim's order of loading.
LOADED = (
    *("metrics", "mass_balance", "ground_reactions", "external_reactions", "buoyant_forces"),
    "propulsion",
    *(*SYSTEMS, "aerodynamics"),
)


@dataclass(frozen=True)
class Choices:
    """Options for reading an aircraft.

    filters: whether lags, washouts, integrators and other dynamic components have states. Otherwise
        their steady-state output is used.
    throttles: whether each engine has a separate throttle.
    engines: whether the lags of engines are states. Otherwise engines follow their throttles at
        once.
    inputs: properties that are inputs of the model, in addition to the pilot's commands.
    folder: folder of the aircraft's other files, "" for that of its file.
    """

    filters: bool = False
    throttles: bool = False
    engines: bool = False
    inputs: tuple[str, ...] = ()
    folder: str = ""


class Parts:
    """Content of the files of an aircraft.

    sections: <metrics>, <aerodynamics>, ... including the content of further files.
    wings: geometry.
    empty: the empty aircraft.
    tanks, points, engines: tanks, point masses and engines.
    mass: mass with the tank contents and point masses in the files.
    """

    def __init__(self, path: Path, folders: Folders, choices: Choices) -> None:
        root = folders.read(path)
        if root.name != "fdm_config":
            fault = f"<{shortened(root.name)}> is not an aircraft file of JSBSim"
            raise root.error(f"{fault}; give a file that begins with <fdm_config>")
        self.path = path
        self.folders = folders
        self.choices = choices
        self.name = root.attributes.get("name", path.stem)
        self.sections: list[Element] = []
        for child in root.children:
            # Of sections of one name, JSBSim reads only the first, but every <system>.
            is_first = self.section(child.name) is None
            if child.name in LOADED and (is_first or child.name == "system"):
                self.sections.append(folders.merged(child))
        propulsion = self.section("propulsion")
        self.wings = read_metrics(self._needed("metrics"))
        self.tanks = read_tanks(propulsion)
        balance = self._needed("mass_balance")
        self.empty = read_empty(balance)
        self.points = [read_point_mass(child) for child in balance.all("pointmass")]
        self.mass = mass_in_file(balance, self.empty, self.tanks, self.points)
        mounts = propulsion.all("engine") if propulsion else ()
        self.engines: list[EngineFile] = [
            read_engine(number, mount, folders.opened, self.tanks)
            for number, mount in enumerate(mounts)
        ]

    @property
    def thrusters(self) -> list[tuple[str, str]]:
        """Kind and thruster of each engine."""
        return [(file.kind, file.thruster.name) for file in self.engines]

    def section(self, name: str) -> Element | None:
        """Return the first section of this name, or None."""
        return next((part for part in self.sections if part.name == name), None)

    def systems(self) -> list[Element]:
        """Return the sections of the control system, in JSBSim's order."""
        return [part for name in SYSTEMS for part in self.sections if part.name == name]

    def _needed(self, name: str) -> Element:
        """Return the first section of this name. Raises BadInputError without one."""
        section = self.section(name)
        if section is None:
            raise BadInputError(f"{self.path}: the aircraft has no <{name}>; add this element")
        return section
