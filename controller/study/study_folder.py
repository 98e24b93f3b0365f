"""Where the rows of a study are kept as they are finished: one file each, known again by the runs that it holds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from controller.study.published_study import PlannedRun, StudyRow, StudyRun
from controller.study.study_report import load_study, study_data
from hfa_model.jobs.finished import finished, stamped
from hfa_model.provenance import Provenance
from hfa_model.support.errors import BadInputError
from hfa_model.support.files import write_text


@dataclass(frozen=True)
class StudyFolder:
    """The folder of a study; made when the first row is kept. origin: what signs each row."""

    path: Path
    origin: Provenance

    def keep(self, row: StudyRow, planned: Sequence[PlannedRun]) -> None:
        """Write a finished row, whole or not at all."""
        self.path.mkdir(exist_ok=True)
        signed = {"provenance": self.origin.to_dict()}
        data = stamped(study_data((row,)) | signed, _decides(row.name, planned))
        write_text(self._file(row.name), json.dumps(data, indent=1, allow_nan=False) + "\n")

    def known(self, name: str, planned: Sequence[PlannedRun]) -> tuple[StudyRun, ...] | None:
        """The runs of a row that this version finished with the same settings; None when they are to be made."""
        path = self._file(name)
        if finished(path, _decides(name, planned)) is None:
            return None
        try:
            return load_study(path)[0].runs
        except (BadInputError, IndexError):
            return None

    def _file(self, name: str) -> Path:
        words = "".join(letter if letter.isalnum() else " " for letter in name).split()
        return self.path / f"{'-'.join(words)}.json"


def _decides(name: str, planned: Sequence[PlannedRun]) -> dict[str, Any]:
    runs = [{"dihedral_deg": run.dihedral_deg, **asdict(run.settings), **run.stack} for run in planned]
    return {"row": name, "runs": runs}
