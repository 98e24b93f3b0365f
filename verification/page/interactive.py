"""Interactive plots: a Plotly figure as JSON in the page, drawn by Plotly's own script."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from hfa_support.jsonable import jsonable
from hfa_support.reporting.report import Picture

#: data, layout and, where a slider moves it, frames, as Plotly's figure schema has them.
PlotlyFigure: TypeAlias = Mapping[str, Any]
#: Colors that stand apart on a light and on a dark page, also for the color-blind (Okabe, Ito 2008).
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
NEUTRAL = "#888888"
_GRID = {"gridcolor": "rgba(128,128,128,0.3)", "zerolinecolor": "rgba(128,128,128,0.8)"}


@dataclass(frozen=True, eq=False)
class InteractivePlot(Picture):
    """A picture that is one or more Plotly figures on a page of HTML; elsewhere it is drawn as other pictures are."""

    figures: tuple[PlotlyFigure, ...]

    def html(self) -> str:
        """Boxes, figures and one caption; the page that holds them brings Plotly's script."""
        key, text = self.name.removesuffix(".png"), html.escape(self.text)
        boxes = "".join(
            f'<div class="plot" id="plot-{key}-{number}" role="img" aria-label="{text}"></div>'
            f'<script type="application/json" data-plot="plot-{key}-{number}">{in_script(figure)}</script>'
            for number, figure in enumerate(self.figures, start=1)
        )
        return f'<figure><div class="plots">{boxes}</div><figcaption>{text}</figcaption></figure>'


def in_script(value: Any) -> str:
    """The value as JSON of which no word can end the script element that holds it."""
    return json.dumps(jsonable(value), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def axis(title: str, lowest: float, highest: float, **more: Any) -> dict[str, Any]:
    """An axis with its title and range."""
    return {"title": {"text": title}, "range": [lowest, highest], **_GRID, **more}


def layout(x: dict[str, Any], y: dict[str, Any]) -> dict[str, Any]:
    """A layout that takes its background and its size from the page; the legend above."""
    return {
        "xaxis": x,
        "yaxis": y,
        "autosize": True,
        "margin": {"l": 50, "r": 40, "t": 10, "b": 45},
        "hovermode": "closest",
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "modebar": {"orientation": "v", "bgcolor": "rgba(0,0,0,0)", "color": NEUTRAL, "activecolor": COLORS[1]},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02},
    }


def frames(traces: Sequence[Sequence[Mapping[str, Any]]], numbers: Sequence[int]) -> list[dict[str, Any]]:
    """A frame for each position of the slider, named by it; numbers: of the traces that change."""
    return [
        {"name": str(position), "data": list(changed), "traces": list(numbers)}
        for position, changed in enumerate(traces)
    ]
