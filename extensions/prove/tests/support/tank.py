"""A tank with inflow proportional to its level and a saturated valve.

The true regions of attraction are known.
"""

from __future__ import annotations

from hfa_aircraft.model import Model, Signal

LIMITS = {"level": (-1.2, 1.2), "slope": (-1.0, 1.0), "valve": (-1.0, 1.0), "load": (-3.0, 3.0)}
TANK = Model(
    "tank",
    {name: Signal("m", 1.0, *LIMITS[name]) for name in ("level", "slope")},
    {"valve": Signal("m/s", 1.0, -1.0, 1.0)},
    lambda x, u, p, w: (
        {"level": p.inflow * x.level + u.valve, "slope": 0.0 * x.slope},
        {"load": 2.0 * x.level},
    ),
    outputs={"load": Signal("m", 1.0, -3.0, 3.0)},
    parameters={"inflow": Signal("1/s", start=0.5)},
    linear=("level",),
    trim={"level": 0.0, "slope": 0.25},
)
