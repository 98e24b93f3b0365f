"""Writing of parameter files."""

from __future__ import annotations

import json
from pathlib import Path

from hfa_model.parameters import FIELDS, ParameterSet
from hfa_support.files import write_text


def save_parameters(parameters: ParameterSet, path: Path, header: str) -> None:
    """Write a parameter file, from which `load_parameters` restores the exact values.

    An error leaves no partial file.

    parameters: the set
    path: path of the file
    header: comment at the beginning of the file
    """
    lines = [f"# {line}" for line in header.splitlines()]
    errors = parameters.standard_errors
    for name, spec in FIELDS._asdict().items():
        lines += [
            "",
            f"[{name}]",
            f"value = {getattr(parameters.values, name)!r}",
            f'unit = "{spec.unit}"',
        ]
        lines += [f'source = "{parameters.sources[name]}"']
        if name in errors:
            lines += [f"standard_error = {errors[name]:.3g}"]
        if name in parameters.notes:
            lines += [f"note = {json.dumps(parameters.notes[name])}"]  # JSON strings are valid TOML
    if parameters.covariance.size:
        names = ", ".join(f'"{name}"' for name in parameters.identified)
        rows = ",\n".join(f"  {row}" for row in parameters.covariance.tolist())
        lines += ["", "[covariance]", f"names = [{names}]", f"rows = [\n{rows},\n]"]
    write_text(path, "\n".join(lines) + "\n")
