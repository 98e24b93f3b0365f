"""The main job on one self-contained HTML page."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import ParameterSet
from hfa_model.support.checks import checks_block
from hfa_model.support.report import Picture, Report
from hfa_model.support.text import in_degrees
from hfa_model.variants import variant_named
from trim.sweeps.sweep import Sweep, sweep
from verification.published.judged_critic import JudgedCritic, critic_picture, judged_critic
from verification.published.regeneration import Regeneration, regenerate_all
from verification.published.regeneration_report import difference_picture

SCHEMA = "hfa.report/1"
TITLE = "Highly flexible aircraft: linear models"
#: Dihedral angles of the sweep, rad: the paper's range and a little beyond.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))

_STYLE = """
body { font-family: sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #222; }
table { display: block; overflow-x: auto; border-collapse: collapse; font-size: 0.8em; margin: 1em 0; }
th, td { padding: 0.2em 0.8em; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap; }
thead th { background: #f6f6f6; }
th:first-child { text-align: left; }
img { max-width: 100%; }
.yes { color: #06630a; } .no { color: #a30000; }
"""


@dataclass(frozen=True, eq=False)
class MainJob:
    """One aircraft: both pairs regenerated, the sweep, a critic learned and judged at each printed angle."""

    parameters: ParameterSet
    regeneration: Regeneration
    sweep: Sweep
    critics: tuple[JudgedCritic, ...]

    @property
    def learned(self) -> bool:
        """Whether every learned critic agrees with the exact game solution."""
        return all(critic.check.ok for critic in self.critics)

    @property
    def ok(self) -> bool:
        """Whether everything holds."""
        return self.regeneration.ok and self.learned


def main_job(parameters: ParameterSet, dynamics: str) -> MainJob:
    """Regenerate both pairs, learn and judge a critic on each, and sweep the dihedral angle."""
    aircraft = Aircraft(parameters.values, variant_named(dynamics))
    regeneration = regenerate_all(aircraft)
    critics = tuple(judged_critic(pair.model) for pair in regeneration.pairs)
    return MainJob(parameters, regeneration, sweep(aircraft, {"dihedral": SWEEP}), critics)


def main_report(job: MainJob) -> Report:
    """Everything on the page below its verdict; data: every number."""
    regeneration, swept, first = job.regeneration.report(), job.sweep.report(), job.critics[0]
    pairs = job.regeneration.pairs
    checks = [Report(f"{pair.published.dihedral_deg:g} deg", (checks_block(pair.checks),)) for pair in pairs]
    critic = Picture("critic.png", "Learned and exact value, and the error over time", lambda: critic_picture(first))
    judged = [each.report() for each in job.critics]
    return Report(
        title="",
        parts=(
            difference_picture(job.regeneration),
            *checks,
            Report("Root locus over the dihedral angle", ("The paper's range ends at 15 degrees.", swept)),
            Report("The learned critic against the exact game solution", (critic, *judged)),
            Report("Entry by entry", tuple(pair.report() for pair in pairs)),
            Report("The aircraft", (job.parameters.report(),)),
        ),
        data={
            "schema": SCHEMA,
            "ok": job.ok,
            "regeneration": regeneration.data,
            "sweep": swept.data,
            "critics": [
                {"dihedral_deg": in_degrees(critic.model.point.states.dihedral), **critic.check.to_dict()}
                for critic in job.critics
            ],
        },
    )


def page(job: MainJob, report: Report) -> str:
    """The page; pictures are embedded, nothing is loaded from elsewhere."""
    regenerated = _verdict(job.regeneration.ok, "regenerated", "NOT regenerated")
    agrees = _verdict(job.learned, "agrees", "DOES NOT agree")
    names = json.dumps(sorted(picture.name for picture in report.pictures()))
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{TITLE}</title>
<meta name="pictures" content='{names}'><style>{_STYLE}</style></head><body>
<h1>{TITLE}</h1>
<p>Both printed pairs (A, B) are {regenerated} from one set of parameters, {job.sweep.dynamics} dynamics.
The learned critic {agrees} with the exact solution of the game at both angles.</p>
{report.html()}
</body></html>
"""


def _verdict(ok: bool, yes: str, no: str) -> str:
    return f'<strong class="yes">{yes}</strong>' if ok else f'<strong class="no">{no}</strong>'
