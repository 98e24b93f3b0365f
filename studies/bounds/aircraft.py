"""Two models of the documents: a van der Pol oscillator with a force, and the tutorial's Navion."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import hfa

_TUTORIAL = Path(__file__).parents[2] / "docs" / "aircraft.md"


def van_der_pol(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Return the state derivatives and the outputs of the van der Pol oscillator in reversed time.

    x'' = -x - (1 - x²) x', with a force
    """
    velocity_rate = x.position - (1.0 - x.position**2) * x.velocity + u.force
    return {"position": -x.velocity, "velocity": velocity_rate}, {}


VAN_DER_POL = hfa.Model(
    "van der Pol",
    {"position": hfa.Signal(), "velocity": hfa.Signal()},
    {"force": hfa.Signal("N", min=-0.5, max=0.5)},
    van_der_pol,
    trim={"position": 0.0, "velocity": 0.0},
)


def navion_of_the_tutorial() -> hfa.Model:
    """Return the longitudinal Navion with four states, loaded from the code in the tutorial."""
    text = _TUTORIAL.read_text(encoding="utf-8")
    found = re.search(r"```python\n# navion.py\n(.*?)```", text, re.DOTALL)
    assert found is not None  # the tutorial contains navion.py
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "navion.py"
        path.write_text(found[1], encoding="utf-8")
        return hfa.load_model(f"{path}:NAVION")
