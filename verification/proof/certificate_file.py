"""Certificates as JSON files: every number a double in full, under a digest."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError
from hfa_model.support.files import write_text
from hfa_model.support.jsonable import jsonable
from hfa_model.support.version import toolchain_version
from verification.proof.gain_table import GainTable
from verification.proof.schedule_proof import Cover, ProvedBox
from verification.proof.stated_model import StatedModel
from verification.proof.taylor import DihedralBox
from verification.proof.trim_branch import Family

SCHEMA = "hfa.certificate/1"


#: Seconds between two writings of an unfinished certificate.
_PAUSE = 2.0


class Certificate:
    """The certificate of one claim: a file that holds what is proved so far, whole at any time.

    The claim says of which aircraft, which flights, which gains and over which angles (deg) it is. No file without
    a path.
    """

    def __init__(self, family: Family, table: GainTable, low: float, high: float, path: Path | None) -> None:
        spread = family.spread or (0.0,) * len(family.aircraft.parameters)
        self.table, self._path, self._saved = table, path, time.monotonic()
        self._claim = jsonable(
            {
                "dynamics": family.aircraft.variant.name,
                "parameters": family.aircraft.parameters._asdict(),
                "spread": dict(zip(Parameters._fields, spread, strict=True)),
                "settings": family.settings,
                "dihedral_deg": [low, high],
                "table": {"dihedral_deg": table.dihedral_deg, "K": table.K},
            }
        )

    def save(self, loop: Cover, modes: Cover, *, finished: bool = False) -> None:
        """Write what there is, at most every `_PAUSE` seconds until it is finished."""
        if self._path is None or not (finished or time.monotonic() - self._saved > _PAUSE):
            return
        self._saved = time.monotonic()
        content = jsonable(
            {
                "schema": SCHEMA,
                "toolchain": toolchain_version(),
                "statement": self._claim,
                "loop": [_entry(each) for each in loop.proved],
                "modes": [_entry(each) for each in modes.proved],
                "open": {"loop": _ends(loop), "modes": _ends(modes)},
            }
        )
        write_text(self._path, json.dumps(content | {"digest": digest(content)}) + "\n")

    def known(self) -> tuple[Cover, Cover]:
        """What an earlier run proved of the same claim; BadInputError when the file is not its certificate."""
        assert self._path is not None
        try:
            content = json.loads(self._path.read_text(encoding="utf-8"))
            whole = content["schema"] == SCHEMA and content["digest"] == digest(content)
            same = content["statement"] == self._claim and content["toolchain"] == toolchain_version()
            loop, modes = (
                Cover(tuple(map(_box, content[name])), tuple(DihedralBox(*ends) for ends in content["open"][name]))
                for name in ("loop", "modes")
            )
        except OSError as error:
            raise BadInputError(f"{self._path}: cannot be read ({error.strerror})") from error
        except (ValueError, KeyError, TypeError) as error:
            raise BadInputError(f"{self._path}: is not a certificate ({error})") from error
        if not whole:
            raise BadInputError(f"{self._path}: is not a certificate as it was written; remove it and begin again")
        if not same:
            raise BadInputError(f"{self._path}: is of another statement or version; write to another file")
        return loop, modes


def digest(content: dict[str, Any]) -> str:
    """SHA-256 of a certificate without its digest: an edited digit shows, even one that proves as much."""
    kept = {key: value for key, value in content.items() if key != "digest"}
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()


def _ends(cover: Cover) -> list[list[float]]:
    return [[each.low, each.high] for each in cover.open]


def _entry(proved: ProvedBox) -> dict[str, Any]:
    model = proved.model
    return {
        "dihedral_deg": [proved.box.low, proved.box.high],
        "unstable": proved.unstable,
        "rate": proved.rate,
        "H": proved.H,
        **{name: getattr(model, name) for name in ("trim", "radius", "A", "B")},
    }


def _box(entry: dict[str, Any]) -> ProvedBox:
    arrays = {name: np.array(entry[name], dtype=float) for name in ("trim", "radius", "A", "B")}
    box = DihedralBox(*entry["dihedral_deg"])
    return ProvedBox(box, entry["unstable"], entry["rate"], np.array(entry["H"]), StatedModel(**arrays))
