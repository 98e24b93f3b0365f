"""The accuracy of the linear model at 10 deg: its widest error bands, and bands of the modes.

The half-width of a band is two standard errors, caused by the rounding of the printed matrices. The
modes are computed for 1000 draws of A within its bands. Entries are drawn independently although
the entries of a row are correlated, so the ranges are too wide rather than too narrow. The script,
run with .venv/bin/python, prints

    published
      A(pitch_rate, alpha)             -155.6092 ± 9.0e-05
      A(pitch_rate, dihedral)             1.3825 ± 4.2e-05
      A(dihedral_rate, dihedral_rate)    -7.4955 ± 4.1e-05
      short period     real part   -4.6311 ± 3.1e-05 1/s
      dihedral (fast)  real part   -7.2258 ± 6.0e-05 1/s
      phugoid          real part   -0.0042 ± 1.0e-06 1/s
      dihedral (slow)  real part   -0.0105 ± 1.0e-06 1/s
    newton
      A(dihedral_rate, dihedral_rate)   -33.8970 ± 2.1e-03
      A(pitch_rate, alpha)              -98.7659 ± 8.1e-05
      A(dihedral_rate, alpha)             0.8319 ± 6.4e-05
      dihedral (fast)  real part  -33.8784 ± 2.1e-03 1/s
      short period     real part   -4.5485 ± 2.3e-05 1/s
      phugoid          real part   -0.0010 ± 4.6e-07 1/s
      dihedral (slow)  real part   -0.0103 ± 1.9e-06 1/s
"""

import numpy as np

import hfa
from trim import entry_bands, modes_of

shipped = hfa.paper.default_parameters()
for dynamics in ("published", "newton"):
    aircraft = hfa.aircraft(dynamics, shipped.values)
    condition = hfa.paper.level_flight(np.radians(10.0))
    model = hfa.linearize(aircraft, hfa.trim(aircraft, condition))
    bands = entry_bands(shipped, condition, model)
    print(dynamics)
    for i in np.argsort(-bands.A, axis=None)[:3]:
        row, column = np.unravel_index(i, bands.A.shape)
        name = f"A({model.states[row]}, {model.states[column]})"
        print(f"  {name:32}{model.A[row, column]:10.4f} ± {bands.A[row, column]:.1e}")
    rng = np.random.default_rng(0)
    draws = [model.A + bands.A * rng.uniform(-1, 1, bands.A.shape) for _ in range(1000)]
    for mode in modes_of(model.A, model.states, model.point.model.modes):
        roots = [np.linalg.eigvals(A) for A in draws]
        nearest = [row[np.abs(row - mode.eigenvalue).argmin()] for row in roots]
        spread = np.abs(np.real(nearest) - mode.eigenvalue.real).max()
        print(f"  {mode.name:16} real part {mode.eigenvalue.real:9.4f} ± {spread:.1e} 1/s")
