"""One job of a given size in a process of its own: `python -m benchmarks.sized sweep 1000` prints time, memory, disk.

The time is from an empty store to a full one, without the start of the process and the import of the libraries.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.report import Size


def sized(job: str, rows: int) -> Size:
    """Run a job in a new process."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.sized", job, str(rows)], check=True, capture_output=True, text=True
    )
    return Size(**json.loads(done.stdout))


def sweep(rows: int, path: Path) -> None:
    """Trims, linear models and eigenvalues over `rows` dihedral angles."""
    from hfa_model import default_parameters
    from trim.sweeps.stored_sweep import stream_sweep
    from trim.sweeps.sweep_plan import Steps, SweepPlan

    steps = Steps(0.0, float(np.radians(20.0)) / rows, rows)
    stream_sweep(SweepPlan({"dihedral": steps}, default_parameters().values, "published"), path)


def members(rows: int, path: Path) -> None:
    """Nonlinear flights of 0.1 s in turbulence, with parameter errors and noise."""
    from benchmarks.members_case import gain_plan
    from controller.monte_carlo.stored_members import stream_monte_carlo

    stream_monte_carlo(gain_plan(rows, duration=0.1), path)


JOBS = {"sweep": sweep, "members": members}


def main() -> None:
    """Run the job that the command line names."""
    name, rows = sys.argv[1], int(sys.argv[2])
    with tempfile.TemporaryDirectory() as folder:
        import casadi  # noqa: F401  # loaded before the clock starts, as in a session that works
        import zarr  # noqa: F401

        start = time.perf_counter()
        JOBS[name](rows, Path(folder) / "store.zarr")
        seconds = (time.perf_counter() - start) / rows
        disk = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file()) / rows
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(Size(rows, seconds, memory, disk)._asdict()))


if __name__ == "__main__":
    main()
