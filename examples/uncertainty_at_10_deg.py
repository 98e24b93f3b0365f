"""How far the linear model at 10 deg can be trusted: the widest bands, and what they do to the modes.

The band of an entry is two standard errors from the rounding of the print plus the distance to a rival structure that
fits the print as well. The modes are computed again for 1000 draws of A within its bands. Entries are drawn one by one;
the entries of one row really move together, so the ranges are rather too wide than too narrow. Run it with
.venv/bin/python; it prints

    published
      A(dihedral_rate, dihedral_rate)    -7.4955 ± 0.0014
      A(dihedral_rate, pitch_rate)        1.9684 ± 0.0004
      A(pitch_rate, alpha)             -155.6092 ± 0.0001
      short period     real part   -4.6311, from -4.6313 to -4.6309 1/s
      dihedral (fast)  real part   -7.2258, from -7.2276 to -7.2240 1/s
      phugoid          real part   -0.0042, from -0.0043 to -0.0042 1/s
      dihedral (slow)  real part   -0.0105, from -0.0105 to -0.0105 1/s
    newton
      A(dihedral_rate, dihedral_rate)   -33.8970 ± 21.4435
      A(dihedral_rate, alpha)             0.8319 ± 0.5263
      A(dihedral_rate, dihedral)         -0.3744 ± 0.2369
      dihedral (fast)  real part  -33.8784, from -55.3104 to -12.4201 1/s
      short period     real part   -4.5485, from -4.5634 to -4.5454 1/s
      phugoid          real part   -0.0010, from -0.0017 to -0.0008 1/s
      dihedral (slow)  real part   -0.0103, from -0.0445 to -0.0023 1/s
"""

import numpy as np

from hfa_model import Aircraft, default_parameters
from trim import entry_bands, find_operating_point, level_flight, linearize, modes_of

shipped = default_parameters()
for dynamics in ("published", "newton"):
    aircraft, condition = Aircraft(shipped.values, dynamics), level_flight(np.radians(10.0))
    model = linearize(aircraft, find_operating_point(aircraft, condition))
    bands = entry_bands(shipped, condition, model)
    print(dynamics)
    for i in np.argsort(-bands.A, axis=None)[:3]:
        row, column = np.unravel_index(i, bands.A.shape)
        name = f"A({model.states[row]}, {model.states[column]})"
        print(f"  {name:32}{model.A[row, column]:10.4f} ± {bands.A[row, column]:.4f}")
    rng = np.random.default_rng(0)
    draws = [model.A + bands.A * rng.uniform(-1, 1, bands.A.shape) for _ in range(1000)]
    for mode in modes_of(model.A, model.states):
        nearest = [min(np.linalg.eigvals(A), key=lambda root: abs(root - mode.eigenvalue)) for A in draws]
        real = np.real(nearest)
        print(f"  {mode.name:16} real part {mode.eigenvalue.real:9.4f}, from {real.min():.4f} to {real.max():.4f} 1/s")
