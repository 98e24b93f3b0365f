"""Coverage of the confidence bands of `hfa identify` on simulated records, and planted faults.

`python -m studies.coverage [COUNT [POLE [FIRST]]]` identifies seven parameters from COUNT records
(default 200). The search begins at 1.5 times the true values. The noise is white, or has a pole of
0.9 or 0.98. If POLE is given, only this pole is used (0 is white noise). FIRST is the seed of the
first record (default 0). The study prints how many searches converge, how many 95 % bands contain
the true value, and the findings of failed runs.

`python -m studies.coverage faults` plants faults in records with white noise.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from hfa import identify, trim
from hfa_aircraft.model import Model
from hfa_aircraft.readers.derivatives.read import from_derivatives
from hfa_support.errors import BadInputError, NoSolutionError

AIRCRAFT = "examples/uav.toml"
FREE = ("CL_0", "CL_alpha", "CD_0", "Cm_0", "Cm_alpha", "Cm_q", "Cm_elevator")
#: Measured state -> standard deviation of its noise.
SENSORS = {"speed": 0.3, "alpha": 0.003, "pitch_rate": 0.01, "pitch": 0.003}
#: Poles of the noise.
POLES = (0.0, 0.9, 0.98)
#: Duration and sample interval of a record, s, and initial factor on the parameters.
_SECONDS = 8.0
_INTERVAL = 0.04
_OFF = 1.5
#: Number of noise samples before a record begins.
_BEFORE = 500

Columns = dict[str, np.ndarray]


def simulated_record(model: Model) -> Columns:
    """Return the columns of a simulated record with a 3-2-1-1 elevator input (2 deg, 0.4 s per
    unit).

    SciPy integrates the equations. The record has no noise.
    """
    point = trim(model)
    time = np.arange(0.0, _SECONDS, _INTERVAL)
    inputs = np.tile(np.array(point.inputs), (len(time), 1))
    place = np.searchsorted([0.5, 1.7, 2.5, 2.9, 3.3], time, side="right")
    moves = np.radians(2.0) * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[place]
    inputs[:, list(model.inputs).index("elevator")] += moves
    f = model.functions()

    def rates(at: float, x: np.ndarray) -> np.ndarray:
        u = [np.interp(at, time, column) for column in inputs.T]
        return np.asarray(f(x, u, model.p)[0].full().ravel())

    ends = (0.0, time[-1])
    x = solve_ivp(
        rates, ends, list(point.states), t_eval=time, rtol=1e-9, atol=1e-11, max_step=_INTERVAL
    ).y
    states = {name: x[list(model.states).index(name)] for name in SENSORS}
    return {"time": time, **dict(zip(model.inputs, inputs.T, strict=True)), **states}


def with_noise(columns: Columns, seed: int, pole: float = 0.0) -> Columns:
    """Return the columns of a record with added sensor noise.

    The autocorrelation of the noise at a lag of k samples is pole^k.
    """
    random = np.random.default_rng(seed)
    noisy = dict(columns)
    for name, size in SENSORS.items():
        white = random.standard_normal(len(columns["time"]) + _BEFORE)
        noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white)[_BEFORE:]
        noisy[name] = columns[name] + size * noise
    return noisy


def coverage(model: Model, columns: Columns, count: int, pole: float, first: int) -> None:
    """Identify the parameters from `count` records with one kind of noise, and print the coverage.

    model: model with the true parameters
    columns: columns of the record without noise
    pole: pole of the noise, 0 for white noise
    first: seed of the first record
    """
    begun = model.with_parameters(**{n: _OFF * model.parameters[n].start for n in FREE})
    held = converged = failed = 0
    findings: Counter[str] = Counter()
    for seed in range(first, first + count):
        found = identify(begun, with_noise(columns, seed, pole), FREE)
        converged += found.converged
        for name, each in found.parameters.items():
            held += each.low <= model.parameters[name].start <= each.high
        if not found.ok:
            failed += 1
            findings[next(iter(found.findings)).split(" of ")[0]] += 1
    share = 100.0 * held / (count * len(FREE))
    print(
        f"pole {pole:g}: {converged} of {count} converged, {held} of {count * len(FREE)} bands hold"
        f" ({share:.1f} %), {failed} FAIL"
    )
    for finding, times in findings.most_common():
        print(f"  {times} x {finding}")


def faults() -> Iterator[tuple[str, str, Callable[[np.ndarray], np.ndarray]]]:
    """Yield each fault: description, column, and a function from the correct to the faulty
    values.
    """
    for column in ("alpha", "pitch_rate", "pitch", "elevator"):
        yield "degrees", column, np.degrees
        yield "sign", column, np.negative
        yield "two samples late", column, _late
        yield "scale 1.3", column, lambda x: 1.3 * x
    yield "two samples late", "speed", _late
    for factor, text in ((1.0 / 0.3048, "ft/s"), (1.0 / 0.514444, "knots"), (3.6, "km/h")):
        yield text, "speed", lambda x, factor=factor: factor * x  # type: ignore[misc]
    yield "lbf", "thrust", lambda x: x / 4.448222
    for column in SENSORS:
        yield "frozen", column, lambda x: np.where(np.arange(len(x)) > 100, x[100], x)
        yield "outlier", column, _with_outlier
    yield "NaN", "elevator", lambda x: np.where(np.arange(len(x)) == 50, np.nan, x)
    yield "not increasing", "time", lambda x: np.where(np.arange(len(x)) == 50, x[49], x)
    yield "milliseconds", "time", lambda x: 1000.0 * x
    yield "infinite", "alpha", lambda x: np.where(np.arange(len(x)) == 50, np.inf, x)


def _late(values: np.ndarray) -> np.ndarray:
    """Return the column delayed by two samples."""
    return np.concatenate([values[:1], values[:1], values[:-2]])


def _with_outlier(values: np.ndarray) -> np.ndarray:
    """Return the column with one value changed by ten times the range of the column."""
    return values + np.where(np.arange(len(values)) == 99, 10.0 * np.ptp(values), 0.0)


def plant(model: Model, columns: Columns) -> None:
    """Plant each fault in a record, and print the outcome of the identification."""
    begun = model.with_parameters(**{n: 1.2 * model.parameters[n].start for n in FREE})
    silent = count = 0
    for text, column, change in faults():
        wrong = with_noise(columns, 11)
        wrong[column] = change(wrong[column])
        try:
            found = identify(begun, wrong, FREE)
            line = found.first_line
            delay = found.column_errors.get(f"delay_{column}")
            if found.ok and delay:
                line += f" (delay {delay.value:.3g} s, band +- {delay.half:.2g} s)"
        except (BadInputError, NoSolutionError) as error:
            line = f"refused: {error}"
        count += 1
        silent += line.startswith("PASS")
        print(f"{column} {text}: {line}", flush=True)
    print(f"{count - silent} of {count} named or refused")


def main() -> None:
    """Run the study selected by the command line."""
    model = from_derivatives(AIRCRAFT)
    columns = simulated_record(model)
    if sys.argv[1:] == ["faults"]:
        plant(model, columns)
        return
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    first = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    for pole in [float(each) for each in sys.argv[2:3]] or POLES:
        coverage(model, columns, count, pole, first)


if __name__ == "__main__":
    main()
