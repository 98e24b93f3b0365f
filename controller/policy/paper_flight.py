"""What Section 5 of the paper imposes on a flight: start, command and disturbance (5.1), sensor noise (5.4).

Deviations from trim in ft/s, rad and rad/s, in the order of `LINEAR_STATES`. The print has lost all signs; they are
taken as positive, and its derivative 0.01 + cos(0.5 t) of the speed's command agrees with that.
"""

from __future__ import annotations

import numpy as np

from controller.policy.signals import Harmonic, Signal

_NONE = np.zeros(6)

#: x(0).
INITIAL = np.array([5.0, 0.05, 0.0, 0.0, 0.0, 0.0])
#: x_d: 7 + 0.01 t + 2 sin(0.5 t) ft/s, 0.1 rad of the angle of attack, 0.5 rad of the dihedral.
REFERENCE = Signal(
    np.array([7.0, 0.1, 0.0, 0.0, 0.5, 0.0]),
    np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0]),
    (Harmonic(0.5, np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]), _NONE),),
)
#: d, 1.1 times the printed amplitudes.
DISTURBANCE = Signal(
    _NONE,
    _NONE,
    (Harmonic(0.1, np.array([0.11, 0.22, 0.0, 0.11, 0.0, 0.11]), np.array([0.0, 0.0, 0.22, 0.0, 0.11, 0.0])),),
)
#: n, added to the measured states and nothing else.
NOISE = Signal(
    _NONE,
    _NONE,
    (
        Harmonic(0.1, np.array([0.0, 0.0, 0.005, 0.0, 0.005, 0.0]), np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0])),
        Harmonic(0.5, np.array([0.0, 0.005, 0.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.005, 0.0, 0.005])),
    ),
)
