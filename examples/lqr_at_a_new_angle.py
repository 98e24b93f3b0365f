"""An LQR at a dihedral angle that the paper does not print, and its response to a speed command.

The aircraft is trimmed and linearized at 10 deg. Each state and input is weighted by its largest
acceptable deviation (Bryson's rule). The command is an increase of 1 ft/s, for which the target is
the trim at the new speed. The script, run with .venv/bin/python, prints

    slowest closed-loop pole -0.1757 1/s
    speed after 0.5, 1, 2, 10 s: 0.192, 0.416, 0.762, 1.000 ft/s
    largest change of the dihedral angle: 0.16 deg
    largest throttle          4.57 lbf
    largest aileron_center    0.33 deg
    largest aileron_outer     0.94 deg
    largest elevator_center   1.44 deg
    largest elevator_outer    2.08 deg
    the same gain at 5 deg: slowest pole -0.1831 1/s
    the same gain at 15 deg: slowest pole -0.1690 1/s
"""

import control
import numpy as np

import hfa

aircraft = hfa.aircraft()
point = hfa.trim(aircraft, dihedral=np.radians(10.0))
plant = point.linearize().to_control()

degree = np.radians(1.0)
large_x = np.array([1.0, 2 * degree, 2 * degree, 2 * degree, 2 * degree, 2 * degree])
large_u = np.array([10.0, 2 * degree, 2 * degree, 2 * degree, 2 * degree])
K, _, poles = control.lqr(plant, np.diag(large_x**-2.0), np.diag(large_u**-2.0))
print(f"slowest closed-loop pole {max(poles.real):.4f} 1/s")

faster = hfa.trim(aircraft, dihedral=np.radians(10.0), speed=69.0)
x_d = np.array([faster[name] - point[name] for name in plant.state_labels])
u_d = faster.u - point.u

# u = u_d - K (x - x_d)
command = (u_d + K @ x_d)[:, None]
closed = control.ss(plant.A - plant.B @ K, plant.B @ command, np.eye(6), np.zeros((6, 1)))
time = np.linspace(0.0, 10.0, 1001)
x = control.step_response(closed, time).states[:, 0]
u = u_d[:, None] - K @ (x - x_d[:, None])
speed = x[plant.state_labels.index("speed")]
dihedral = x[plant.state_labels.index("dihedral")]
speeds = ", ".join(f"{speed[i]:.3f}" for i in (50, 100, 200, 1000))
print(f"speed after 0.5, 1, 2, 10 s: {speeds} ft/s")
print(f"largest change of the dihedral angle: {np.degrees(np.abs(dihedral).max()):.2f} deg")
for name, row in zip(plant.input_labels, u, strict=True):
    largest = np.abs(row).max()
    if name == "throttle":
        print(f"largest {name:15} {largest:6.2f} lbf")
    else:
        print(f"largest {name:15} {np.degrees(largest):6.2f} deg")

for degrees in (5.0, 15.0):
    other = hfa.paper.level_model(aircraft, np.radians(degrees))
    abscissa = max(np.linalg.eigvals(other.A - other.B @ K).real)
    print(f"the same gain at {degrees:g} deg: slowest pole {abscissa:+.4f} 1/s")
