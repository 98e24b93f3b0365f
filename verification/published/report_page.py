"""The main job on one self-contained HTML page."""

from __future__ import annotations

import base64
import html
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import FIELDS, Parameters, ParameterSet
from hfa_model.support.checks import checks_text
from hfa_model.support.figure import png_bytes
from hfa_model.support.text import columns, in_degrees
from hfa_model.variants import variant_named
from trim.sweeps.root_locus import root_locus_figure
from trim.sweeps.sweep import Sweep, sweep
from trim.sweeps.sweep_report import sweep_text, sweep_warnings
from verification.published.judged_critic import JudgedCritic, critic_picture, critic_text, judged_critic
from verification.published.regeneration import RegeneratedPair, regenerate_all, regeneration_data, regeneration_text
from verification.published.regeneration_figure import regeneration_figure

SCHEMA = "hfa.report/1"
#: Dihedral angles of the sweep, rad: the paper's range and a little beyond.
SWEEP = np.radians(np.arange(0.0, 20.01, 0.5))

_STYLE = """
body { font-family: sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #222; }
pre { background: #f6f6f6; padding: 1em; overflow-x: auto; font-size: 0.8em; line-height: 1.35; }
img { max-width: 100%; }
.yes { color: #06630a; } .no { color: #a30000; }
"""


@dataclass(frozen=True)
class Report:
    """What the page shows of one aircraft: regeneration, sweep, a critic learned and judged at each printed angle."""

    parameters: ParameterSet
    pairs: tuple[RegeneratedPair, ...]
    sweep: Sweep
    critics: tuple[JudgedCritic, ...]

    @property
    def regenerated(self) -> bool:
        """Whether both printed pairs were regenerated."""
        return all(pair.ok for pair in self.pairs)

    @property
    def learned(self) -> bool:
        """Whether every learned critic agrees with the exact game solution."""
        return all(critic.check.ok for critic in self.critics)


def make_report(parameters: ParameterSet, dynamics: str) -> Report:
    """Regenerate both pairs and sweep the dihedral angle, there and then."""
    aircraft = Aircraft(parameters.values, variant_named(dynamics))
    pairs = regenerate_all(aircraft)
    critics = tuple(judged_critic(pair.model) for pair in pairs)
    return Report(parameters, pairs, sweep(aircraft, {"dihedral": SWEEP}), critics)


def report_data(report: Report) -> dict[str, Any]:
    """Every number on the page."""
    return {
        "schema": SCHEMA,
        "ok": report.regenerated and report.learned,
        "regeneration": regeneration_data(report.pairs),
        "sweep": report.sweep.to_dict() | {"warnings": sweep_warnings(report.sweep)},
        "critics": [
            {"dihedral_deg": in_degrees(critic.model.point.states.dihedral), **critic.check.to_dict()}
            for critic in report.critics
        ],
    }


def report_pictures(report: Report) -> dict[str, bytes]:
    """File name -> PNG."""
    return {
        "regeneration.png": png_bytes(regeneration_figure(report.pairs)),
        "root_locus.png": png_bytes(root_locus_figure(report.sweep)),
        "critic.png": png_bytes(critic_picture(report.critics[0])),
    }


def report_html(report: Report, pictures: dict[str, bytes]) -> str:
    """The page; pictures are embedded, nothing is loaded from elsewhere."""
    regenerated = _verdict(report.regenerated, "regenerated", "NOT regenerated")
    agrees = _verdict(report.learned, "agrees", "DOES NOT agree")
    names = json.dumps(sorted(pictures))
    checks = "\n\n".join(f"{pair.published.dihedral_deg:g} deg\n{checks_text(pair.checks)}" for pair in report.pairs)
    critics = "\n\n".join(critic_text(critic) for critic in report.critics)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Highly flexible aircraft: linear models</title>
<meta name="pictures" content='{names}'><style>{_STYLE}</style></head><body>
<h1>Highly flexible aircraft: linear models</h1>
<p>Both printed pairs (A, B) are {regenerated} from one set of parameters, {report.sweep.dynamics} dynamics.
The learned critic {agrees} with the exact solution of the game at both angles.</p>
<pre>{html.escape(checks)}</pre>
{_image("regeneration.png", pictures, "Difference of every entry from its print")}
<h2>Root locus over the dihedral angle</h2>
<p>The paper's range ends at 15 degrees.</p>
{_image("root_locus.png", pictures, "Eigenvalues over the dihedral angle")}
<pre>{html.escape(sweep_text(report.sweep))}</pre>
<h2>The learned critic against the exact game solution</h2>
{_image("critic.png", pictures, "Learned and exact value, and the error over time")}
<pre>{html.escape(critics)}</pre>
<h2>Entry by entry</h2>
<pre>{html.escape(regeneration_text(report.pairs))}</pre>
<h2>The aircraft</h2>
<pre>{html.escape(_parameters(report.parameters))}</pre>
</body></html>
"""


def _verdict(ok: bool, yes: str, no: str) -> str:
    return f'<strong class="yes">{yes}</strong>' if ok else f'<strong class="no">{no}</strong>'


def _image(name: str, pictures: dict[str, bytes], text: str) -> str:
    data = base64.b64encode(pictures[name]).decode("ascii")
    return f'<p><img alt="{html.escape(text)}" src="data:image/png;base64,{data}"></p>'


def _parameters(parameters: ParameterSet) -> str:
    rows = [
        (name, f"{getattr(parameters.values, name):.7g}", getattr(FIELDS, name).unit, parameters.sources[name])
        for name in Parameters._fields
    ]
    return columns(("parameter", "value", "unit", "source"), rows)
