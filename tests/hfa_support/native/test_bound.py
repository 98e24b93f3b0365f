"""Functions of many rows, and sweeps computed by several threads of one process."""

from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np

import hfa
from hfa_support.native.bound import RowFunction


class _Recorded(ca.Callback):
    """x -> 1/x, with the arguments of its evaluations in `seen`."""

    def __init__(self):
        ca.Callback.__init__(self)
        self.seen = []
        self.construct("recorded", {})

    def eval(self, arguments):
        self.seen.append(float(arguments[0]))
        return [1.0 / arguments[0]]


def test_a_function_is_evaluated_at_the_given_rows_only():
    """The rows that fill up a block of 16 repeat given rows: the function sees no other points."""
    recorded = _Recorded()
    (found,) = RowFunction(recorded)(np.arange(1.0, 11.0)[:, None])
    np.testing.assert_allclose(found[:, 0], 1.0 / np.arange(1.0, 11.0))
    assert set(recorded.seen) == set(np.arange(1.0, 11.0))


def test_concurrent_sweeps_equal_sequential_sweeps():
    """They are equal bit by bit."""

    def swept(number):
        rng = np.random.default_rng(number)
        angles, speeds = np.radians(rng.uniform(0.0, 20.0, 8)), rng.uniform(25.0, 75.0, 6)
        found = hfa.sweep(hfa.aircraft(), {"dihedral": np.sort(angles), "speed": np.sort(speeds)})
        return [
            getattr(found, name).tobytes() for name in ("states", "inputs", "A", "B", "eigenvalues")
        ]

    alone = [swept(number) for number in range(3)]
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(swept, range(3))) == alone
