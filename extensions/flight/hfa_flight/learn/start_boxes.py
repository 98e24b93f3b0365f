"""Sample times and initial-condition boxes of environments."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.delay import steps_of
from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.sampled_flights import CompiledSamples, SampledFlight, Ticks
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_radius
from trim.linear.linearize import linearize
from trim.point.operating_point import OperatingPoint

#: Sample times, s, the longest first. One is chosen by its product with the fastest pole.
_SAMPLE_TIMES = (0.02, 0.01, 0.005, 0.002, 0.001)
_FASTEST = 1.0
#: Time that flights without action must survive, s.
_SURVIVED = 1.0
#: Shares of a box that are tried, the largest first.
_SHARES = np.array([1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1])
#: Factor on the found box, because only some of its states are tried.
_MARGIN = 0.95
#: Numbers of drawn states, and of states up to which all corners of a box are tried.
_DRAWN = 200
_CORNERS = 6


def sample_time(model: Model, points: Sequence[OperatingPoint]) -> float:
    """Return the sample time of a default environment, s.

    It is the longest of 20, 10, 5, 2 and 1 ms whose product with the fastest pole is at most 1, of
    the aircraft and of its LQR loop with the default weights at all trims. A slower policy than the
    LQR does not need a shorter one.
    """
    from controller.game.linear_game import game
    from controller.riccati.gare import solve

    fastest = 0.0
    for point in points:
        linear = linearize(model, point)
        fastest = max(fastest, spectral_radius(linear.A))
        try:
            K = solve(game(linear, delta=np.inf)).K
        except NoSolutionError:
            continue
        fastest = max(fastest, spectral_radius(linear.A - linear.B @ K))
    within = [dt for dt in _SAMPLE_TIMES if dt * fastest <= _FASTEST]
    return max(within, default=_SAMPLE_TIMES[-1])


def surviving_boxes(
    flight: SampledFlight,
    points: Sequence[OperatingPoint],
    boxes: np.ndarray,
    action: np.ndarray,
) -> np.ndarray:
    """Return half-widths (N, k) from which flights with a constant action stay for `_SURVIVED` s.

    Each half-width is reduced to the largest of the `_SHARES` from which flights with this
    deviation alone stay within the limits, and then the whole box to the largest share from whose
    corners, and from `_DRAWN` drawn states, they stay.

    boxes: half-widths about each trim, (N, k)
    action: (m,)
    """
    k = boxes.shape[1]
    sides = np.vstack([np.eye(k), -np.eye(k)])
    inside = np.random.default_rng(0).uniform(-1.0, 1.0, (_DRAWN, k))
    corners = np.array([*itertools.product((-1.0, 1.0), repeat=k)]) if k <= _CORNERS else sides
    dt = max(flight.dt, _SAMPLE_TIMES[0])  # a constant action needs no shorter samples
    flight = replace(flight, dt=dt, steps_per_sample=parts_of_a_sample(points, dt, [*boxes]))
    held = CompiledSamples(
        flight,
        entering=lambda states, _: [states],
        network=lambda rows: np.tile(action, (len(rows), 1)),
        stepper=Ticks(flight.tick(), dt, is_long=True),
    )
    reduced = []
    for point, box in zip(points, boxes, strict=True):
        of_sides = _surviving_shares(held, point, box, sides)
        alone = np.minimum(of_sides[:k], of_sides[k:]) * box
        joint = _surviving_shares(held, point, alone, np.vstack([corners, inside]))
        reduced.append(_MARGIN * joint.min() * alone)
    return np.array(reduced)


def _surviving_shares(
    samples: CompiledSamples, point: OperatingPoint, box: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Return the largest of the `_SHARES` of a box up to which flights stay, by direction, (D,).

    If none stays, the share is the smallest.

    box: half-widths about the trim, (k,)
    directions: (D, k), in half-widths
    """
    model, flight = point.model, samples.flight
    rows = model.state_places(model.linear)
    count = len(directions) * len(_SHARES)
    starts = np.tile(point.x, (count, 1))
    deviations = directions[:, None, :] * _SHARES[:, None] * box
    starts[:, rows] += deviations.reshape(count, len(box))
    trims = np.tile(flight.deployed.trim_vector(point), (count, 1))
    ticks = steps_of(_SURVIVED, flight.dt)
    flown, _ = samples.fly(flight.start(starts, trims), trims, ticks)
    envelope = flight_envelope(model, point)
    stays = flight.stays(flown.states, envelope.least, envelope.most).all(axis=1)
    stays = stays.reshape(len(directions), len(_SHARES))
    # True where the flights of this share, and of all smaller ones, stay.
    up_to_share = np.logical_and.accumulate(stays[:, ::-1], axis=1)[:, ::-1]
    return np.where(up_to_share.any(axis=1), _SHARES[up_to_share.argmax(axis=1)], _SHARES[-1])
