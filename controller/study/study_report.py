"""What the study of the paper's update law says, its data read back, and the folder where finished rows are kept."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from controller.laws.published_law import PublishedSettings
from controller.study.published_study import PlannedRun, StudyRow, StudyRun
from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError
from hfa_support.files import read_json, write_text
from hfa_support.jobs.finished import finished, stamped
from hfa_support.jsonable import jsonable
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, range_text

SCHEMA = "hfa.published-study/2"
#: Numbers that are nan, not inf, where a run did not get so far.
_NAN = ("last_lambda_0",)
_SECONDS = ("settled", "explicit_step_limit", "predefined_time", "step")
_RANGES = ("lambda_0", "alpha1", "alpha2", "explicit_step_limit", "P_error", "K_error", "settled", "last_lambda_0")


def study_report(rows: tuple[StudyRow, ...]) -> Report:
    """Outcomes, what the theorem asks for, and causes; smallest and largest value over the runs of a row."""
    outcomes = [
        (
            row.name,
            *("-" if count is None else str(count) for count in _counts(row).values()),
            *(range_text(*row.span(name)) for name in ("P_error", "K_error")),
            range_text(*row.span("settled"), "never"),
        )
        for row in rows
    ]
    demands = [
        (row.name, *(range_text(*row.span(name)) for name in ("lambda_0", "alpha1", "alpha2", "explicit_step_limit")))
        for row in rows
    ]
    return Report(
        title="The paper's update law, Eq. (46), on both printed models (15 and 5 deg)",
        parts=(
            Table(
                (
                    "row",
                    "runs",
                    "overflow",
                    "stabilizing",
                    "certified",
                    "by rounding",
                    "error of P",
                    "error of K",
                    "settled s",
                ),
                outcomes,
            ),
            Table(("row", "lambda_0", "alpha1", "alpha2", "largest explicit step s"), demands),
            "\n".join(f"{row.name}: {row.cause}" for row in rows),
        ),
        data=study_data(rows),
        records=_records(rows),
    )


def load_study(path: str | Path) -> tuple[StudyRow, ...]:
    """The rows of a file with `study_data`, bit by bit. Raises BadInputError for another file."""
    try:
        data = read_json(path)
    except (OSError, ValueError) as error:
        raise BadInputError(f"{path} cannot be read as the .json file of a study") from error
    try:
        if data["schema"] != SCHEMA:
            raise KeyError("schema")
        return tuple(StudyRow(row["name"], row["cause"], tuple(map(_run, row["runs"]))) for row in data["rows"])
    except (KeyError, TypeError, AttributeError) as error:
        raise BadInputError(f"{path} is not a study of this version ({SCHEMA})") from error


def study_data(rows: tuple[StudyRow, ...]) -> dict[str, Any]:
    """Ready for JSON: counts, ranges [smallest, largest] and every run; a number that is not finite becomes None."""
    return {
        "schema": SCHEMA,
        "rows": [
            {
                "name": row.name,
                "cause": row.cause,
                **_counts(row),
                "ranges": {name: jsonable(row.span(name)) for name in _RANGES},
                "runs": [jsonable(asdict(run)) for run in row.runs],
            }
            for row in rows
        ],
    }


def _records(rows: tuple[StudyRow, ...]) -> Table:
    """One row a run."""
    numbers = [field.name for field in fields(StudyRun) if field.name != "settings"]
    settings = [field.name for field in fields(PublishedSettings)]
    body = [
        (row.name, *(getattr(run, name) for name in numbers), *(getattr(run.settings, name) for name in settings))
        for row in rows
        for run in row.runs
    ]
    header = [f"{name} [s]" if name in _SECONDS else name for name in (*numbers, *settings)]
    return Table(("row", *header), body)


def _counts(row: StudyRow) -> dict[str, int | None]:
    return {
        "count": len(row.runs),
        "overflow": len(row.runs) - len(row.finished),
        "stabilizing": sum(run.stabilizing for run in row.runs),
        "certified": sum(run.certified for run in row.runs),
        "decided_by_rounding": row.decided_by_rounding,
    }


def _run(stored: Mapping[str, Any]) -> StudyRun:
    values: dict[str, Any] = {
        name: (math.nan if name in _NAN else math.inf) if value is None else value for name, value in stored.items()
    }
    values["P_errors_nearby"] = tuple(values["P_errors_nearby"])
    settings: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in values["settings"].items()
    }
    return StudyRun(**values | {"settings": PublishedSettings(**settings)})


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
