"""Entries of a table from a stability file of AVL (`.st`), the output of its command ST.

AVL computes derivatives per rad of alpha, beta and the rates p b/2V, q c/2V, r b/2V about the
stability axes of the run case, and per degree of a control variable. Moments are about the point
Xref, Yref, Zref. In the coefficients of a table, the deflections of the run case are 0:

  C_0 = C_tot - C_d1 δ_1 - C_d2 δ_2 - ...

Files without CDa (AVL 3.40 and older) contain the derivatives of Cl and Cn with respect to controls
about body axes, and the other derivatives about stability axes. Source: AVL, `aoutput.f`, of
versions 3.31, 3.40 and 3.52.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from hfa_aircraft.readers.derivatives.names import (
    COEFFICIENTS,
    INDUCED,
    THRUST_INPUT,
    UNITS,
    Entry,
    number,
)
from hfa_aircraft.signals import identifiers
from hfa_support.errors import BadInputError, shown
from hfa_support.files import regular_file
from hfa_support.units import conversion_factor

#: Entry of a table that names the stability file.
AVL = "avl"
#: Unit of the lengths of the stability file, and the point about which its moments must act.
_LENGTH = "length"
_CENTER = "center_of_gravity"
#: Entries that the stability file gives.
_GIVEN_BY_FILE = ("axes", "wing_area", "span", "chord", "alpha")
#: Total of each coefficient, about stability axes.
_TOTALS = {"CL": "CLtot", "CD": "CDtot", "CY": "CYtot", "Cl": "Cl'tot", "Cm": "Cmtot",
           "Cn": "Cn'tot"}  # fmt: skip
#: Suffix of a derivative in the stability file -> suffix in a table.
_ARGUMENTS = {"a": "alpha", "b": "beta", "p": "p", "q": "q", "r": "r"}
_REFERENCE = ("Xref", "Yref", "Zref")
_ZERO_IN_STRAIGHT_FLIGHT = ("Beta", "pb/2V", "qc/2V", "rb/2V")
_KNOWN_NAME = re.compile(
    "|".join(
        (
            "[SCB]ref",
            *_REFERENCE,
            "Alpha",
            "Mach",
            *_ZERO_IN_STRAIGHT_FLIGHT,
            "CDvis",
            "e",
            *_TOTALS.values(),
        )
    )
    + r"|C[LDYlmn](?:[abpqr]|d\d+)"
)
#: Half a unit of the last digit that AVL prints of rates and derivatives.
_PRINTED_ZERO = 5e-6
_DERIVATIVE_ZERO = 5e-7
#: Relative accuracy of the reference point, which AVL prints with five digits.
_REFERENCE_TOLERANCE = 1e-4
#: Difference of the factors sqrt(1 - M²) of AVL and of the flight condition that needs no note.
_COMPRESSIBILITY = 0.05
_WRITE_AGAIN = "write the file again with ST in AVL's menu OPER"


@dataclass(frozen=True)
class StabilityFile:
    """Content of a stability file of AVL.

    path: path of the file
    content: its bytes
    values: name in the file -> value and place
    controls: name of a control variable, as an identifier -> deflection in deg and place
    """

    path: str
    content: bytes
    values: Mapping[str, Entry]
    controls: Mapping[str, Entry]

    def value(self, name: str) -> float:
        """Return a number of the file."""
        if name not in self.values:
            raise BadInputError(f"{self.path}: {name} is missing; {_WRITE_AGAIN}")
        return number(name, self.values[name], "1")

    @property
    def reference_point(self) -> tuple[float, ...]:
        """Point about which the moments act, the center of gravity, in the axes of AVL."""
        return tuple(self.value(name) for name in _REFERENCE)

    def total(self, coefficient: str) -> float:
        """Return a coefficient at the run case."""
        return self.value(_TOTALS[coefficient])

    def slope(self, coefficient: str, control: int) -> float:
        """Return the derivative with respect to a control, per deg, about stability axes.

        Older files have Cl and Cn about body axes, which the angle of attack rotates:
        Cl' = Cl cos α + Cn sin α, Cn' = Cn cos α - Cl sin α.

        control: number of the control in the file, from 1
        """
        if "CDa" in self.values or coefficient not in ("Cl", "Cn"):
            return self.value(f"{coefficient}d{control}")
        alpha = math.radians(self.value("Alpha"))
        roll = self.value(f"Cld{control}")
        yaw = self.value(f"Cnd{control}")
        if coefficient == "Cl":
            return roll * math.cos(alpha) + yaw * math.sin(alpha)
        return yaw * math.cos(alpha) - roll * math.sin(alpha)

    def notes(self, has_drag: bool, mach: float) -> Iterator[str]:
        """Yield what a user of the aircraft should know about the file.

        has_drag: whether the table gives the drag, CD_0
        mach: Mach number of the flight condition of the table
        """
        if not has_drag and self.value("CDvis") == 0.0:
            yield (
                f"the drag of {self.path} is induced drag alone (CDvis 0); add CD_0 to the table,"
                " or CDCL to the .avl file"
            )
        # Prandtl-Glauert factors sqrt(1 - M²), by which AVL corrects for compressibility.
        factor_of_file, factor_of_flight = (
            math.sqrt(max(0.0, 1.0 - mach_number**2)) for mach_number in (self.value("Mach"), mach)
        )
        if abs(factor_of_file - factor_of_flight) > _COMPRESSIBILITY:
            yield (
                f"{self.path} is for Mach {self.value('Mach'):g}, and the flight condition has Mach"
                f" {mach:.3g}"
            )


def read_stability_file(path: str) -> StabilityFile:
    """Return the content of a printed stability file of AVL.

    Raises BadInputError if the file is another one, its axes are not x forward and z down, a value
    is given twice, or the run case is not that of a whole aircraft in straight flight without
    sideslip.
    """
    content = regular_file(path).read_bytes()
    lines = list(enumerate(content.decode("utf-8", "replace").splitlines(), start=1))
    if not any("Stability-axis derivatives" in line for _, line in lines):
        raise BadInputError(f"{path} contains no stability derivatives of AVL; {_WRITE_AGAIN}")
    if lines[0][1].strip() == "DERMATS":
        raise BadInputError(f"{path} is machine-readable (MRF); type MRF again and {_WRITE_AGAIN}")
    values: dict[str, Entry] = {}
    deflections: dict[str, Entry] = {}
    for place, name, value, is_deflection in _printed_values(lines):
        if not is_deflection:
            name = re.sub(r"(?<=d)0+(?=\d)", "", name)  # CLd01 is CLd1
        entry = Entry(value, f"{path}, line {place}")
        of_its_kind = deflections if is_deflection else values
        if name in of_its_kind:
            raise entry.error(f"{name} is given twice; write each run case to a file of its own")
        of_its_kind[name] = entry
    for place, line in lines:
        if "Geometric axis orientation" in line:
            raise BadInputError(
                f"{path}, line {place}: x is aft and z up; choose x forward and z down (OPER, O, A)"
                " in AVL and write the file again"
            )
    file = StabilityFile(path, content, values, _controls(deflections, values, path))
    _refuse_run_case(file)
    return file


def _controls(
    deflections: Mapping[str, Entry], values: Mapping[str, Entry], path: str
) -> dict[str, Entry]:
    """Return the deflections of the controls that have derivatives, by identifier."""
    count = sum(name.startswith("CLd") for name in values)
    if len(deflections) < count:
        raise BadInputError(
            f"{path}: {count} controls have derivatives, but only {len(deflections)} have a "
            f"deflection; {_WRITE_AGAIN}"
        )
    identifier = identifiers(deflections)
    before_design_variables = list(deflections.items())[:count]
    return {identifier[name]: entry for name, entry in before_design_variables}


def _refuse_run_case(file: StabilityFile) -> None:
    """Raise BadInputError unless a whole aircraft is in straight flight without sideslip."""
    if abs(file.value("Clp")) <= _DERIVATIVE_ZERO:
        raise file.values["Clp"].error(
            "Clp is 0, because the case is one half of a symmetric aircraft; set iYsym to 0 in the "
            ".avl file, with YDUPLICATE, and write the file again"
        )
    for name in _ZERO_IN_STRAIGHT_FLIGHT:
        if abs(file.value(name)) > _PRINTED_ZERO:
            raise file.values[name].error(
                f"{name} is {file.value(name):g}; write the file at a run case with {name} 0"
            )


class _Value(NamedTuple):
    """Value in a stability file.

    place: number of the line
    name: name of the value, for a deflection that of the control
    text: the value
    is_deflection: whether the value is the deflection of a control
    """

    place: int
    name: str
    text: str
    is_deflection: bool


def _printed_values(lines: Iterable[tuple[int, str]]) -> Iterable[_Value]:
    """Yield the values in the lines of a printed file."""
    # The deflections stand between the line of CYff, the last of the total forces, and a rule.
    shows_deflections = False
    for place, line in lines:
        if line.strip().startswith("---"):
            shows_deflections = False
        if shows_deflections:
            control, equals, deflection = line.rpartition("=")
            if equals:
                yield _Value(place, control.strip(), deflection.strip(), is_deflection=True)
        elif ":" not in line and " / " not in line:  # no title, and not the spiral criterion
            for name, value in re.findall(r"([A-Za-z][\w'/]*)\s*=\s*([^\s|]+)", line):
                if _KNOWN_NAME.fullmatch(name):
                    yield _Value(place, name, value, is_deflection=False)
        if "CYff" in line:
            shows_deflections = True


def with_stability_file(
    given: Mapping[str, Entry], file: StabilityFile, where: str
) -> dict[str, Entry]:
    """Return the entries of a table, completed by a stability file of AVL.

    Derivatives of the table replace those of the file. A control variable has limits in the table,
    or a fixed deflection.

    given: entries of the table
    where: the table, for messages

    Raises BadInputError for a missing or wrong entry.
    """
    for name in _GIVEN_BY_FILE:
        if name in given:
            raise given[name].error(f"{name} is in {file.path} too; remove {name}")

    own = {_name_in_model(name, file): entry for name, entry in given.items()}
    length = _length(own, where)
    _refuse_other_center(own, file, where)
    fixed = _fixed_deflections(own, file, where)
    for name in (_LENGTH, _CENTER, *fixed):  # read above; a table without a stability file has none
        del own[name]

    entries = {
        "axes": Entry("stability", file.path),
        "wing_area": _with_unit(file, "Sref", f"{length}^2"),
        "span": _with_unit(file, "Bref", length),
        "chord": _with_unit(file, "Cref", length),
        "alpha": _with_unit(file, "Alpha", "deg"),
    }

    _refuse_missing_drag(own, file, where)
    # With the entry INDUCED, C_D is C_D,0 + INDUCED C_L², and the slopes in the file are not used.
    has_drag_slope = INDUCED not in own and "CDa" in file.values
    for coefficient in COEFFICIENTS:
        if coefficient == "CD" and not has_drag_slope:
            induced = number(INDUCED, own[INDUCED], "1") if INDUCED in own else 0.0
            value = file.total("CD") - induced * file.total("CL") ** 2
            entries["CD_0"] = Entry(value, file.path)
        else:
            entries |= _entries_of_coefficient(coefficient, file, fixed)
    return {**entries, **own}


def _name_in_model(name: str, file: StabilityFile) -> str:
    """Return the name of an entry; of a control, the identifier in place of AVL's name."""
    (identifier,) = identifiers([name]).values()
    return identifier if identifier in file.controls else name


def _entries_of_coefficient(
    coefficient: str, file: StabilityFile, fixed: Mapping[str, float]
) -> dict[str, Entry]:
    """Return the entries of a coefficient: its value without deflections, and its derivatives."""
    # The file has the total at the deflections δ of its run case. A control without limits stays at
    # the deflection δ_f of the table: C_0 = C_tot + Σ C_d (δ_f - δ), with δ_f = 0 for the others.
    # fixed: control variable -> deflection in deg, for those without limits
    value = file.total(coefficient)
    entries: dict[str, Entry] = {}
    for suffix, argument in _ARGUMENTS.items():
        slope = file.value(coefficient + suffix)
        if abs(slope) > _DERIVATIVE_ZERO:
            entries[f"{coefficient}_{argument}"] = _with_unit(file, coefficient + suffix, "1/rad")
    for k, (control, deflection) in enumerate(file.controls.items(), start=1):
        slope = file.slope(coefficient, k)
        value += slope * (fixed.get(control, 0.0) - number(control, deflection, "deg"))
        if control not in fixed and abs(slope) > _DERIVATIVE_ZERO:
            entries[f"{coefficient}_{control}"] = Entry(f"{slope!r} 1/deg", file.path)
    return {f"{coefficient}_0": Entry(value, file.path), **entries}


def _with_unit(file: StabilityFile, name: str, unit: str) -> Entry:
    """Return a value of a file with its unit."""
    return Entry(f"{file.value(name)!r} {unit}", file.values[name].where)


def _length(own: Mapping[str, Entry], where: str) -> str:
    """Return the unit of the lengths of a stability file, which the table must state."""
    if _LENGTH not in own:
        raise BadInputError(
            f'{where}: {_LENGTH} is missing; add {_LENGTH} = "m", the unit of lengths in the '
            "stability file"
        )
    entry = own[_LENGTH]
    if not isinstance(entry.value, str) or conversion_factor(entry.value, "m") is None:
        raise entry.error(f"{_LENGTH} is {shown(entry.value)}; give m, ft, in, cm or mm")
    return entry.value


def _refuse_other_center(own: Mapping[str, Entry], file: StabilityFile, where: str) -> None:
    """Raise BadInputError unless the moments of a file are about the center of gravity."""
    reference = file.reference_point
    shown_reference = f"[{', '.join(f'{value:g}' for value in reference)}]"
    if _CENTER not in own:
        raise BadInputError(
            f"{where}: {_CENTER} is missing; add {_CENTER} = [x, y, z] in the axes of the .avl "
            f"file ({file.path} has moments about {shown_reference})"
        )
    entry = own[_CENTER]
    value: Any = entry.value
    if not isinstance(value, list | tuple) or len(value) != len(_REFERENCE):
        raise entry.error(f"{_CENTER} is {shown(value)}; give [x, y, z]")
    center = [number(_CENTER, Entry(coordinate, entry.where), "1") for coordinate in value]
    chord = file.value("Cref")
    for given, referred in zip(center, reference, strict=True):
        largest = max(abs(referred), chord)
        if abs(given - referred) > _REFERENCE_TOLERANCE * largest:
            raise entry.error(
                f"{_CENTER} is {shown(value)}, but {file.path} has moments about "
                f"{shown_reference}; set X_cg, Y_cg and Z_cg (OPER, M) in AVL and write the file "
                "again"
            )


def _fixed_deflections(
    own: Mapping[str, Entry], file: StabilityFile, where: str
) -> dict[str, float]:
    """Return control variable -> deflection, deg, for those with one value in a table."""
    fixed = {}
    for control, entry in file.controls.items():
        if control in (*UNITS, THRUST_INPUT):
            raise entry.error(
                f"the control {shown(control)} cannot be the name of an input; rename it in the "
                ".avl file"
            )
        if control not in own:
            raise BadInputError(
                f"{where}: {control}, a control of {file.path}, is missing; add {control} = "
                f'["-25 deg", "25 deg"], its limits, or {control} = 0, if it does not move'
            )
        if not isinstance(own[control].value, list | tuple):
            fixed[control] = math.degrees(number(control, own[control], "rad"))
    return fixed


def _refuse_missing_drag(own: Mapping[str, Entry], file: StabilityFile, where: str) -> None:
    """Raise BadInputError if neither a table nor a stability file says how CD varies."""
    if INDUCED in own or "CD_alpha" in own or "CDa" in file.values:
        return
    ratio = file.value("Bref") ** 2 / file.value("Sref")
    induced = 1.0 / (math.pi * file.value("e") * ratio)
    raise BadInputError(
        f"{where}: {INDUCED} is missing, and {file.path} has no CDa; add {INDUCED} = {induced:.5g},"
        " 1/(pi e b^2/S) with the e of that file, or CD_alpha"
    )
