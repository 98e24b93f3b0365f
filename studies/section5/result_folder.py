"""Where results go: one folder an experiment, there as a whole or not at all, and known by what decided its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError
from hfa_support.files import temporary_folder, write_text
from hfa_support.jobs.finished import finished, stamped
from hfa_support.jsonable import records_text
from hfa_support.reporting.data_files import save_data
from hfa_support.reporting.figure import save
from hfa_support.reporting.report import NO_RECORDS
from studies.section5.flown_laws import LAWS
from studies.section5.panels import PaperFigure, draw
from studies.section5.sections import Experiment, Outcome
from studies.section5.setting import Setting

SCHEMA = "hfa.experiment/1"
_RESULT = "result.json"


def deciding(experiment: Experiment, setting: Setting) -> dict[str, Any]:
    """Everything that decides the numbers of an experiment: matrices, configuration, flights, claims."""
    return {
        "schema": SCHEMA,
        "section": experiment.section,
        "setting": setting.identity,
        "flights": [vars(plan) for plan in experiment.flights(setting)],
        "claims": [[claim.number, claim.what, claim.relation, claim.limit] for claim in experiment.claims],
    }


def result_of(outcome: Outcome, pictures: Sequence[PaperFigure], origin: Provenance) -> dict[str, Any]:
    """What is kept of an experiment beside its pictures, as JSON has it."""
    experiment, setting = outcome.experiment, outcome.setting
    content = {
        "schema": SCHEMA,
        "section": experiment.section,
        "title": experiment.title,
        "matrices": setting.matrices,
        "laws": {law: LAWS[law] for law in dict.fromkeys(plan.law for plan in outcome.flown)},
        "flights": [
            {
                "name": plan.name,
                **vars(plan),
                "learned_from": record.learned_from,
                "metrics": record.metrics.to_dict(),
            }
            for plan, record in outcome.flown.items()
        ],
        "claims": [checked.to_dict() for checked in outcome.claims],
        "pictures": [_name(picture) for picture in pictures],
        "provenance": origin.to_dict(),
    }
    return stamped(content, deciding(experiment, setting))


def write_outcome(outcome: Outcome, folder: Path, origin: Provenance) -> dict[str, Any]:
    """Write the result and all pictures into folder/section, whole or not at all, signed; returns the result.

    An older result of the same section is replaced. Raises BadInputError when the folder cannot be written.
    """
    pictures = outcome.experiment.pictures(outcome.setting, outcome.flown)
    section, result = outcome.experiment.section, result_of(outcome, pictures, origin)
    with ExitStack() as around:
        try:
            unfinished = around.enter_context(temporary_folder(folder))
        except OSError as error:
            raise BadInputError(f"cannot write into {folder}: {error.strerror}; choose another folder") from error
        for picture in pictures:
            arrays = {**picture.arrays, "provenance": origin.to_dict()}
            save_data(unfinished / f"{_name(picture)}.npz", arrays, NO_RECORDS)
            save(draw(picture), unfinished / f"{_name(picture)}.png", origin.text())
        write_text(unfinished / _RESULT, records_text(result))
        unfinished.chmod(0o755)
        _replace(unfinished, folder / section)
    return result


def _name(picture: PaperFigure) -> str:
    return f"figure-{picture.number:02d}"


def finished_experiment(experiment: Experiment, setting: Setting, folder: Path) -> dict[str, Any] | None:
    """The result of an earlier run of this version with the same identity, if all its files are there."""
    place = folder / experiment.section
    result = finished(place / _RESULT, deciding(experiment, setting))
    if result is None:
        return None
    names = [f"{name}.{suffix}" for name in result["pictures"] for suffix in ("png", "npz")]
    return result if all((place / name).is_file() for name in names) else None


def _replace(unfinished: Path, target: Path) -> None:
    """Put a finished folder in the place of an older one."""
    if target.exists():
        with temporary_folder(target.parent) as old:
            target.replace(old / target.name)
            unfinished.replace(target)
    else:
        unfinished.replace(target)
