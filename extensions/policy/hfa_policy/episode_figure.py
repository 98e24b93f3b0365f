"""Picture of an episode: linear states and commanded inputs versus time."""

from __future__ import annotations

import numpy as np

from hfa_policy.episodes import Episodes
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit, shown_values


def episode_picture(
    episodes: Episodes, owner: int, flown: list[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Return the picture of an episode as an array of pixels (height, width, 3).

    owner: index of the episode's trim. Its values are drawn as horizontal lines
    flown: X and U at each sample of the episode
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    deployed = episodes.deployed
    model = deployed.model
    names = (*model.linear, *deployed.commanded)
    known = [*model.states, *model.inputs]
    values = np.array([np.concatenate(pair) for pair in flown])
    times = deployed.deployment.dt * np.arange(len(values))
    trim = episodes.points[owner].values
    lines = -(-len(names) // 2)
    figure = new_figure(8.0, 1.6 * lines)
    panels = figure.subplots(lines, 2, sharex=True, squeeze=False).ravel()
    for name, axes in zip(names, panels, strict=False):
        unit = model.unit(name)
        axes.plot(times, shown_values(values[:, known.index(name)], unit))
        axes.axhline(float(shown_values(trim[name], unit)), color="gray", linewidth=0.8)
        axes.set_ylabel(f"{name}, {shown_unit(unit)}", fontsize=8)
        axes.grid(alpha=0.3)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
