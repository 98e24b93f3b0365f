"""`hfa schedule`: a slow change of dihedral under a schedule, and refused input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from cli import hfa
from scipy.io import savemat

SCHEDULE = ("schedule", "--dihedral", "5", "--to", "15:20:3", "--law", "exact")


def test_gains_of_a_file_are_flown_as_they_are(tmp_path: Path) -> None:
    """The exact gains from a file fly as the exact law does; one gain for all angles, and others, fly otherwise."""
    exact, flown = (tmp_path / name for name in ("exact.json", "flown.json"))
    steps = ("--duration", "26")
    result = hfa(*SCHEDULE, *steps, "-o", str(exact))
    assert (result.code, result.err) == (0, "")
    title = "Flight, published dynamics, dihedral 5 deg, to 15 deg over 20 s, law exact, scheduled"
    assert result.out.startswith(f"{title}\nstayed within limits: 26 s inside the envelope and the control limits\n")
    assert result.out.count("8 hold") == 3
    reference = json.loads(exact.read_text("utf-8"))
    np.testing.assert_allclose(reference["schedule"]["dihedrals"], np.radians([5.0, 10.0, 15.0]))
    K = np.array(reference["schedule"]["gains"])
    files = {"one.json": K[0], "stacked.mat": np.moveaxis(K, 0, -1)}
    words = SCHEDULE[:-2]
    finals = {}
    for name, gains in files.items():
        path = tmp_path / name
        content = {"K": gains, "dihedral_deg": np.array([5.0, 10.0, 15.0])}
        if path.suffix == ".mat":
            savemat(path, content)
        else:
            path.write_text(json.dumps({key: value.tolist() for key, value in content.items()}), encoding="utf-8")
        result = hfa(*words, "--weights", str(path), *steps, "-o", str(flown))
        assert result.code == 0, result.err
        assert f"law gain of {path}, scheduled" in result.out
        data = json.loads(flown.read_text("utf-8"))
        assert data["schedule"]["distances_from_exact"] == [None] * 3
        finals[name] = np.array(data["history"]["states"][-1])
    np.testing.assert_allclose(finals["stacked.mat"], reference["history"]["states"][-1], rtol=1e-9)
    assert abs(finals["one.json"] - finals["stacked.mat"]).max() > 1e-6
