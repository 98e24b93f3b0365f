"""Results shown at the prompt with their fields."""

from __future__ import annotations

from hfa_support.reporting.report import Report, Reported


class Shown(Reported):
    """A dataclass that shows its fields at the prompt, where arrays would fill the screen."""

    def report(self) -> Report:
        """The first line of the docstring, the fields, small matrices, the checks."""
        from hfa_support.reporting.fields_report import fields_report

        return fields_report(self)
