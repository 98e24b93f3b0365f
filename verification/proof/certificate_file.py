"""Certificates as the prover writes them: JSON files, every number a double in full, under the checker's digest."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from controller.policy.gain_table import GainTable
from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError
from hfa_support.files import write_text
from hfa_support.jsonable import jsonable
from hfa_support.version import toolchain_version
from verification.arithmetic import flint_or_refusal
from verification.enclosures.place_box import PlaceBox
from verification.enclosures.trim_branch import Family
from verification.proof.rate_proof import RateProof
from verification.proof.schedule_proof import Cover, ProvedBox, ScheduleProof
from verification.proof.scheduled_loop import LoopTable
from verification.proof.stated_model import StatedModel

#: Seconds between two writings of an unfinished certificate.
_PAUSE = 2.0


def write_certificate(
    path: Path, origin: Provenance, kind: str, statement: dict[str, Any], boxes: dict[str, Any], **more: Any
) -> None:
    """A certificate of any kind: the claim, and the boxes that prove it; by which run is not in its digest."""
    from verification.checker.checker import SCHEMA, sealed

    own = {"schema": SCHEMA, "kind": kind, "toolchain": toolchain_version()}
    content = jsonable(own | {"statement": statement, "boxes": boxes} | more)
    write_text(path, sealed(json.dumps(content)[:-1], json.dumps(jsonable(origin.to_dict()))))


def flights_claim(family: Family, low: float, high: float) -> dict[str, Any]:
    """Which model, which trims and which places a statement is about."""
    from verification.checker.structure import facts_of

    model = family.model
    return {
        **facts_of(model),
        "parameters": {name: signal.start for name, signal in model.parameters.items()},
        "spread": {name: width for name, width in family.spread.items() if width > 0.0},
        "imposed": family.imposed(),
        "limits": family.limits(),
        "range": [low, high],
    }


def box_entry(box: PlaceBox, model: StatedModel, decimals: bool, **more: Any) -> dict[str, Any]:
    """The trims and the linear model on one box, and their proved properties."""
    own = {name: getattr(model, name) for name in ("trim", "A", "B")}
    return {"range": [box.low, box.high], "decimals": decimals, "unstable": 0, "rate": 0.0} | own | more


class ScheduleCertificate:
    """The certificate of one schedule: a file with the proof so far, whole at any time; none without a path.

    The statement says of which aircraft, which flights, which gains and over which places it is.
    """

    def __init__(
        self,
        family: Family,
        table: GainTable | LoopTable,
        low: float,
        high: float,
        path: Path | None,
        origin: Provenance,
    ) -> None:
        table = LoopTable.of(table)
        self.table, self._path, self._origin = table, path, origin
        self._saved, self._family = time.monotonic(), family
        claim = flights_claim(family, low, high) | {
            "table": {name: getattr(table, name) for name in ("places", *"KMNX")}
        }
        if table.actuators is not None:
            claim |= {"actuators": vars(table.actuators)}
        self._claim = jsonable(claim)

    def save(self, loop: Cover, modes: Cover) -> None:
        """Write what there is, at most every `_PAUSE` seconds."""
        if self._path is not None and time.monotonic() - self._saved > _PAUSE:
            self._write(self._path, loop, modes)
            self._saved = time.monotonic()

    def finish(self, proof: ScheduleProof, motion: RateProof | None = None) -> None:
        """Write all of it, the motion too when a rate is proved."""
        if self._path is not None:
            self._write(self._path, proof.loop, proof.modes, proof.bounds, motion)

    def _write(
        self,
        path: Path,
        loop: Cover,
        modes: Cover,
        bounds: tuple[list[ProvedBox], list[ProvedBox]] = ([], []),
        motion: RateProof | None = None,
    ) -> None:
        covers, claim = {"loop": loop, "modes": modes}, dict(self._claim)
        lists = {"loop": loop.proved, "modes": modes.proved, "least": bounds[0], "most": bounds[1]}
        boxes = {name: [self._entry(each) for each in proved] for name, proved in lists.items()}
        if motion is not None and motion.rate > 0.0:
            claim |= {"place_rate": motion.rate, "lyapunov": {"places": motion.places, "P": motion.P}}
            boxes["motion"] = [box_entry(*each[:2], self._family.decimals, turn=each.turn) for each in motion.boxes]
        low, high = claim["range"]
        gaps = {name: [[each.low, each.high] for each in cover.open] for name, cover in covers.items()}
        for name, cover in covers.items():  # what an unfinished proof has not come to is open too
            gaps[name] += [[cover.frontier(low), high]] if cover.frontier(low) < high else []
        write_certificate(path, self._origin, "schedule", claim, boxes, open=gaps)

    def _entry(self, proved: ProvedBox) -> dict[str, Any]:
        own = {"unstable": proved.unstable, "rate": proved.rate} | proved.proof
        return box_entry(proved.box, proved.model, self._family.decimals, **own)

    def known(self) -> tuple[Cover, Cover]:
        """What an earlier run proved of the same claim; verified here, so that nothing in the file is believed.

        BadInputError when the file is not its certificate, or does not prove what it says.
        """
        from verification.checker.checker import Rejected, check_certificate

        assert self._path is not None
        try:
            statement = check_certificate(self._path, model=self._family.model).statement
        except Rejected as error:
            raise BadInputError(f"{error}; remove the file and begin again") from error
        finally:
            flint_or_refusal()  # the checker has its own precision
        content = json.loads(self._path.read_text(encoding="utf-8"))
        same = all(statement.get(key) == value for key, value in self._claim.items())
        if not same or content["toolchain"] != toolchain_version():
            raise BadInputError(f"{self._path}: is of another statement or version; write to another file")
        end = content["statement"]["range"][1]
        gaps = {name: [PlaceBox(*ends) for ends in own if ends[1] != end] for name, own in content["open"].items()}
        loop, modes = (Cover(tuple(map(_box, content["boxes"][name])), tuple(gaps[name])) for name in ("loop", "modes"))
        return loop, modes


def _box(entry: dict[str, Any]) -> ProvedBox:
    model = StatedModel(entry["trim"], np.array(entry["A"]), np.array(entry["B"]))
    proof: dict[str, Any] = {key: entry[key] for key in ("H", "turn", "pieces") if key in entry}
    return ProvedBox(PlaceBox(*entry["range"]), entry["unstable"], entry["rate"], proof, model)
