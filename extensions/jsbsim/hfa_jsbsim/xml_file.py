"""XML files of an aircraft: elements with line numbers, units, and search for files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hfa_support.errors import BadInputError, file_faults, shortened
from hfa_support.files import read_xml, regular_file, resolved


@dataclass
class Element:
    """Element of an XML file.

    name: tag.
    attributes: name -> text.
    children: child elements, in order.
    lines: (line number, text) of each line of text that is not empty.
    file, line: position of the start tag.
    parent: enclosing element, or None for the root.
    """

    name: str
    attributes: dict[str, str]
    file: str
    line: int
    parent: Element | None = None
    children: list[Element] = field(default_factory=list)
    lines: list[tuple[int, str]] = field(default_factory=list)

    @property
    def where(self) -> str:
        """File and line, as used at the beginning of messages."""
        return f"{self.file}:{self.line}"

    @property
    def text(self) -> str:
        """Return the first line of the element's text, or ""."""
        return self.lines[0][1] if self.lines else ""

    def error(self, fault: str) -> BadInputError:
        """Return a BadInputError with the file and line of the element, and a description.

        fault: description of the fault
        """
        return BadInputError(f"{self.where}: {fault}")

    def error_at(self, line: int, fault: str) -> BadInputError:
        """Return a BadInputError with the file and a line number inside the element.

        line: number of the line
        fault: description of the fault
        """
        return BadInputError(f"{self.file}:{line}: {fault}")

    def find(self, name: str) -> Element | None:
        """Return the first child of this name, or None."""
        return next(self.all(name), None)

    def all(self, name: str) -> Iterator[Element]:
        """Yield the children of this name."""
        return (child for child in self.children if child.name == name)

    def need(self, name: str) -> Element:
        """Return the first child of this name. Raises BadInputError without such a child."""
        child = self.find(name)
        if child is None:
            raise self.error(f"<{self.name}> has no <{name}>; add <{name}>")
        return child

    def number(self, unit: str = "") -> float:
        """Return the number in the element.

        unit: unit to which the number is converted if the element has a unit

        Raises BadInputError if the text is not one finite number, or if the unit cannot be
        converted.
        """
        value = self.as_number(" ".join(text for _, text in self.lines))
        own_unit = self.attributes.get("unit", "")
        if not unit or not own_unit or own_unit == unit:
            return value
        return value * self.factor(own_unit, unit)

    def factor(self, own_unit: str, unit: str) -> float:
        """Return the factor that converts values from `own_unit` to `unit`.

        Raises BadInputError for an unknown conversion.
        """
        if (own_unit, unit) in _FACTORS:
            return _FACTORS[own_unit, unit]
        if (unit, own_unit) in _FACTORS:
            return 1.0 / _FACTORS[unit, own_unit]
        raise self.error(
            f'<{self.name}> has the unit "{shortened(own_unit)}", which is not '
            f"supported; give the value in {unit}"
        )

    def as_number(self, text: str) -> float:
        """Return the number in a text. Raises BadInputError unless it is one finite number."""
        value = number_of(text)
        if value is None or not math.isfinite(value):
            raise self.error(f"<{self.name}> contains {shortened(text)!r}; give a finite number")
        return value

    def value_of(self, name: str, default: float, unit: str = "") -> float:
        """Return the number in the first child of this name, or the default without one.

        unit: unit of the result, or "" for no conversion
        """
        child = self.find(name)
        return default if child is None else child.number(unit)

    def vector(self, unit: str) -> np.ndarray:
        """Return the numbers in the children x, y, z or roll, pitch, yaw, (3,).

        A missing child counts as 0.

        unit: unit of the result
        """
        own_unit = self.attributes.get("unit", "") or unit
        factor = 1.0 if own_unit == unit else self.factor(own_unit, unit)
        numbers = []
        for names in (("x", "roll"), ("y", "pitch"), ("z", "yaw")):
            child = self.find(names[0]) or self.find(names[1])
            numbers.append(0.0 if child is None else child.number() * factor)
        return np.array(numbers)


#: (from, to) -> factor, as in `FGXMLElement`. The inverse factors follow.
_FACTORS = {
    ("M", "FT"): 3.2808399,
    ("CM", "FT"): 0.032808399,
    ("KM", "FT"): 3280.8399,
    ("FT", "IN"): 12.0,
    ("M", "IN"): 3.2808399 * 12.0,
    ("M2", "FT2"): 3.2808399**2,
    ("CM2", "FT2"): 0.032808399**2,
    ("FT2", "IN2"): 144.0,
    ("IN3", "CC"): 16.387064,
    ("FT3", "IN3"): 1728.0,
    ("M3", "FT3"): 35.3146667,
    ("LTR", "IN3"): 61.0237441,
    ("LTR", "GAL"): 0.264171,
    ("LBS", "KG"): 0.45359237,
    ("SLUG", "KG"): 14.59390,
    ("SLUG", "LBS"): 14.59390 / 0.45359237,
    ("SLUG*FT2", "KG*M2"): 1.35594,
    ("RAD", "DEG"): 180.0 / math.pi,
    ("WATTS", "HP"): 0.001341022,
    ("N", "LBS"): 0.22482,
    ("ATM", "INHG"): 29.9246899,
    ("PSI", "INHG"): 2.03625437,
    ("INHG", "PSF"): 70.7180803,
    ("INHG", "PA"): 3386.0,
    ("LBS/FT2", "PA"): 14.5939 * 3.2808399,
    ("N/M2", "PA"): 1.0,
    ("KG/SEC", "LBS/SEC"): 1.0 / 0.45359237,
    ("KG/MIN", "LBS/MIN"): 1.0 / 0.45359237,
    ("LBS/HP*HR", "KG/KW*HR"): 0.6083,
    ("KG/L", "LBS/GAL"): 8.3454045,
}


def number_of(text: str) -> float | None:
    """Return the number in a text in the format of C, or None if the text is no such number."""
    try:  # float() also accepts 1_000 and digits of other scripts
        return float(text) if text.isascii() and "_" not in text else None
    except ValueError:
        return None


def parsed(text: bytes, file: str) -> Element:
    """Return the root element of an XML text.

    file: name of the file in messages

    Raises BadInputError as `read_xml`.
    """
    open_elements: list[Element] = []
    roots: list[Element] = []

    def start(name: str, attributes: dict[str, str], line: int) -> None:
        """Open an element within the open one."""
        parent = open_elements[-1] if open_elements else None
        element = Element(name, attributes, file, line, parent)
        (parent.children if parent else roots).append(element)
        open_elements.append(element)

    def characters(piece: str, line: int) -> None:
        """Append a piece of text to the open element."""
        open_elements[-1].lines.append((line, piece))

    read_xml(text, file, start, lambda _: _strip(open_elements.pop()), characters)
    return roots[0]


def _strip(element: Element) -> None:
    """Join the pieces of text on each line of an element."""
    # White space around lines and empty lines are removed.
    lines: dict[int, list[str]] = {}
    for number, text in element.lines:
        lines.setdefault(number, []).append(text)
    stripped = [(number, "".join(pieces).strip()) for number, pieces in lines.items()]
    element.lines = [(number, text) for number, text in stripped if text]


class Folders:
    """Folders with the files of an aircraft, and the files that were read.

    aircraft: folder of the aircraft.
    shared: folders that contain the folders engine and systems, in the order of the search.
    data: folder of JSBSim's data, or None. Messages contain paths relative to this folder.
    """

    def __init__(self, aircraft: Path, shared: tuple[Path, ...], data: Path | None) -> None:
        self.aircraft = aircraft
        self.shared = shared
        self.data = data
        self._files: dict[Path, tuple[Element, str]] = {}

    @property
    def documents(self) -> list[Element]:
        """Root elements of all files that were read."""
        return [document for document, _ in self._files.values()]

    @property
    def digest(self) -> str:
        """SHA-256 digest over the digests of the files that were read, sorted by path."""
        hashes = (digest for _, (_, digest) in sorted(self._files.items()))
        return hashlib.sha256("".join(hashes).encode()).hexdigest()

    def read(self, path: Path) -> Element:
        """Return the root element of a file. Each file is read once.

        Raises BadInputError if the file cannot be read, and as `parsed` does.
        """
        if path not in self._files:
            with file_faults(path):
                text = regular_file(path).read_bytes()
            digest = hashlib.sha256(text).hexdigest()
            name = path
            if self.data is not None and path.is_relative_to(self.data):
                name = path.relative_to(self.data)
            self._files[path] = (parsed(text, str(name)), digest)
        return self._files[path][0]

    def opened(self, element: Element) -> Element:
        """Return the root of the file that an element names, or the element if it names no file."""
        name = element.attributes.get("file", "")
        return self.read(self._found(element, name)) if name else element

    def merged(self, element: Element) -> Element:
        """Return an element extended by the content of the file that it names (`FGModel::Upload`).

        The content of the file precedes the children of the element.

        Raises BadInputError if the file contains another kind of element.
        """
        document = self.opened(element)
        if document is element:
            return element
        if document.name != element.name:
            fault = f"the file contains <{document.name}> instead of <{element.name}>"
            raise document.error(f"{fault}; correct the name in {element.where}")
        both = [*document.children, *element.children]
        attributes = {**document.attributes, **element.attributes}
        return Element(element.name, attributes, document.file, document.line, element.parent, both)

    def _found(self, element: Element, name: str) -> Path:
        """Return the path of the file that an element names."""
        # The same folders are searched as in JSBSim.
        relative = Path(name if name.endswith(".xml") else f"{name}.xml")
        own_folders = [self.aircraft]
        kind = "engine" if element.name in ("engine", "thruster") else "systems"
        if kind == "engine":
            own_folders += [self.aircraft / "Engines", self.aircraft / "engines"]
        elif element.name == "system":
            own_folders += [self.aircraft / "Systems", self.aircraft / "systems"]
        folders = [*own_folders, *(folder / kind for folder in self.shared)]
        for folder in folders:
            path = resolved(folder / relative)
            if not path.is_relative_to(resolved(folder)):
                raise element.error(
                    f"the file {shortened(name)} is outside the aircraft's folders; move the "
                    "file into a folder of the aircraft"
                )
            if path.is_file():
                return path
        raise element.error(
            f"the file {shortened(name)} is not in {', '.join(map(str, folders))}; move the file "
            "into such a folder, or add ?folder=FOLDER to the aircraft's name"
        )
