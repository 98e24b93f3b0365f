"""What the game from measured outputs says: the smallest delta and what ends it, the coupling, the checks."""

from __future__ import annotations

from hfa_model.reporting.checks import checks_block
from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table
from hfa_model.reporting.unit_system import in_force, unit_in_force
from hfa_model.support.errors import NoSolutionError
from hfa_model.support.jsonable import finite_or_none
from verification.riccati.output_feedback import OutputGame, minimum_output_delta, solve_output_feedback


def output_report(problem: OutputGame, sensors: tuple[str, ...], units: tuple[str, ...]) -> Report:
    """The central controller of the game when only the sensors are known.

    Raises NoSolutionError that names the condition that fails.
    """
    smallest, condition = minimum_output_delta(problem)
    delta = problem.game.delta
    if delta < smallest:
        raise NoSolutionError(
            f"from measured outputs alone delta = {delta:.9g} is below delta_min = {smallest:.7g}, where the "
            f"{condition} fails; ask for a larger delta, or measure more"
        )
    found, noise = solve_output_feedback(problem), problem.V.diagonal().tolist()
    of_noise = [f"({unit})^2 s" for unit in units]
    rows = [
        (name, f"{in_force(value, unit):.4g}", unit_in_force(unit))
        for name, value, unit in zip(sensors, noise, of_noise, strict=True)
    ]
    return Report(
        title=f"From measured outputs alone: delta {delta:.6g}, smallest possible {smallest:.7g}"
        + (f", where the {condition} ends it" if condition != "none" else ""),
        parts=(
            Table(("sensor", "noise", "unit"), rows),
            f"coupling rho(XY) / delta^2: {found.coupling:.6g}, must stay below 1",
            checks_block(found.checks),
        ),
        data={
            "sensors": list(sensors),
            "sensor_units": list(units),
            "C": problem.C.tolist(),
            "D": problem.D.tolist(),
            "noise": noise,
            "delta_min": smallest,
            "delta_min_condition": condition,
            "delta_margin": finite_or_none(delta / smallest) if smallest > 0.0 else None,
            "coupling": found.coupling,
            "X": found.X.tolist(),
            "Y": found.Y.tolist(),
            "Ak": found.Ak.tolist(),
            "Bk": found.Bk.tolist(),
            "Ck": found.Ck.tolist(),
            "checks": [check.to_dict() for check in found.checks],
        },
    )
