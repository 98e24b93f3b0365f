"""What a scheduled controller says of itself: its names, and the table of its design, angle by angle."""

from __future__ import annotations

from typing import Any

from controller.design.design import signal_unit
from controller.design.scheduled_controller import ScheduledController
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, in_degrees

SCHEMA = "hfa.controller-design/1"
_MARGINS = ("margin_at_inputs", "margin_at_sensors")


def controller_report(controller: ScheduledController) -> Report:
    """The table of `about`: delta, delta_min, abscissa, margins, certificate; and what is smallest over the angles."""
    angles: list[dict[str, Any]] = list(controller.about.get("angles", ()))
    delta = controller.about.get("delta")
    rows = [
        (
            f"{in_degrees(row['dihedral']):g}",
            f"{row['delta_min']:.6g}",
            f"{row['abscissa']:.4f}",
            *(f"{row[name]['disk']:.4f}" for name in _MARGINS),
            verdict_text(all(check["ok"] for check in row["checks"])),
        )
        for row in angles
    ]
    header = ("dihedral", "delta_min", "abscissa 1/s", "margin at inputs", "at sensors", "certificate")
    smallest = [
        f"smallest disk {name.replace('_', ' ')}: {row[name]['disk']:.4f} at {in_degrees(row['dihedral']):g} deg, "
        f"gain {row[name]['gain']:.4g}, phase {row[name]['phase']:.4g} deg"
        for name in _MARGINS
        for row in sorted(angles, key=lambda row, name=name: float(row[name]["disk"]))[:1]  # type: ignore[misc]
    ]
    told = [f"told: {', '.join(controller.commands)}"] if controller.commands else []
    if controller.command_filter:
        told.append("of a command filter of {:g} rad/s, damping {:g}".format(*controller.command_filter))
    first, last = (in_degrees(float(controller.dihedrals[end])) for end in (0, -1))
    count = len(controller.dihedrals)
    where = f"{count} angles from {first:g} to {last:g} deg" if count > 1 else f"at {first:g} deg"
    return Report(
        f"Controller {controller.name}: {controller.feedback} feedback, {len(controller.states)} states, "
        f"{where}, {controller.dynamics} dynamics",
        (
            f"delta {'inf' if delta is None else format(delta, 'g')}; measured: {', '.join(controller.measurements)}; "
            f"moved: {', '.join(controller.inputs)}" + "".join(f"; {each}" for each in told),
            Table(header, rows),
            "\n".join(smallest),
        ),
        data={
            "schema": SCHEMA,
            "design": controller.name,
            "feedback": controller.feedback,
            **{name: list(getattr(controller, name)) for name in ("states", "measurements", "commands", "inputs")},
            "state_units": [signal_unit(name) for name in controller.states],
            "signal_units": [signal_unit(name) for name in (*controller.measurements, *controller.commands)],
            "input_units": [signal_unit(name) for name in controller.inputs],
            "dihedrals": controller.dihedrals.tolist(),
            **{name: getattr(controller, name).tolist() for name in "ABCDW"},
            "command_filter": list(controller.command_filter),
            "dynamics": controller.dynamics,
            "parameters": controller.parameters,
            "delta": delta,
            "angles": angles,
        },
    )
