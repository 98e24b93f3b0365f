"""Tracking of a reference by the policies of a game: errors, cost, and trims at the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, identity
from controller.riccati.gare import Solution
from controller.riccati.lyapunov import stabilizes
from hfa_aircraft.waveform import Harmonic, Waveform, channel, constant, stacked
from hfa_support.errors import (
    BadInputError,
    is_finite,
    refuse_unknown,
    refuse_unless_positive,
    shown,
)
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Vector, storable
from hfa_support.reporting.text import Table, shown_unit, shown_value
from trim.linear.linear_model import LinearModel
from trim.point.solve import CommandedTrim, commanded_trim


@dataclass(frozen=True, eq=False)
class Feedforward:
    """Policies of the game of tracking a reference x_d(t), u = -K z + u_d(t).

    With z = x - x_d and r = A x_d - x_d', the error obeys z' = A z + B u + E d + r(t). The value is
    V = z'Pz + 2 s'z + c, with the bounded solution s(t) of

        -s' = (A - S P)'s + P r,   -c' = 2 s'r - s'S s,
        u = -R⁻¹(B'(P z + s) + N'z),   d = δ⁻²E'(P z + s).

    solution: of the game of regulation
    reference: x_d, (n,)
    forcing: r, (n,)
    costate: s, (n,)

    Source: Athans and Falb, Optimal Control, Section 9.9, with S in place of B R⁻¹B'.
    """

    solution: Solution
    reference: Waveform
    forcing: Waveform
    costate: Waveform

    @property
    def game(self) -> Game:
        """The game of regulation."""
        return self.solution.game

    @property
    def inputs(self) -> Waveform:
        """Feedforward u_d = -R⁻¹B's, (m,), of the inputs."""
        return self.costate.through(-self.game.R_inverse_B_transposed)


def forcing(A: np.ndarray, reference: Waveform) -> Waveform:
    """Return r = A x_d - x_d', (n,), the effect of a reference x_d on the rate of the error z.

    A: (n, n)
    """
    return reference.through(A) + reference.rate().through(-np.eye(len(A)))


def particular(M: np.ndarray, forcing: Waveform) -> Waveform:
    """Return the solution w(t), (n,), of w' = M w + f(t) that has the form of f.

    With a Hurwitz M, or -M, this is the only solution that grows no faster than f. The sinusoid
    Re(ρ exp(jωt)) of f has Re(σ exp(jωt)) in w, (jω I - M) σ = ρ, and the ramp f_0 + f_1 t has
    w_0 + w_1 t, M w_1 = -f_1, M w_0 = w_1 - f_0.

    M: (n, n), without an eigenvalue 0 or ±jω
    forcing: f, (n,)
    """
    slope = -np.linalg.solve(M, forcing.slope)
    constant = np.linalg.solve(M, slope - forcing.constant)
    identity = np.eye(len(M))
    waves = []
    for wave in forcing.harmonics:
        # sine sin(ωt) + cosine cos(ωt) = Re((cosine - j sine) exp(jωt))
        phasor = np.linalg.solve(1j * wave.frequency * identity - M, wave.cosine - 1j * wave.sine)
        waves.append(Harmonic(wave.frequency, -phasor.imag, phasor.real))
    return Waveform(constant, slope, tuple(waves))


def feedforward(solution: Solution, reference: Waveform) -> Feedforward:
    """Return the exact feedforward of a game for a reference of its states.

    The costate is computed in the states of `Solution.closed_loops`, in which the entries of the
    loop keep their digits.

    Raises BadInputError if the game is in discrete time, or if the reference has another number of
    states than the game.
    """
    game, closed_loops = solution.game, solution.closed_loops
    game.refuse_steps("a reference")
    if reference.size != len(game.A):
        raise BadInputError(
            f"the reference has {reference.size} states; the game has {len(game.A)}"
        )
    r = forcing(game.A, reference)
    minus_P_r = r.through(-closed_loops.rows(solution.enclosure.P).T)
    costate_in_new_states = particular(-closed_loops.worst_loop.T, minus_P_r)
    T = closed_loops.columns(np.eye(len(game.A)))
    return Feedforward(solution, reference, r, costate_in_new_states.through(T.T))


def late_error(exact: Feedforward, K: np.ndarray, inputs: Waveform) -> Waveform:
    """Return the error z(t), (n,), of z' = (A - B K) z + B inputs + r after the transients.

    r = A x_d - x_d' is the effect of the reference x_d (`exact.forcing`). The equation is solved in
    the states T z of `Solution.closed_loops`, in which the loop keeps its digits.

    K: (m, n)
    inputs: (m,)
    """
    solution = exact.solution
    closed_loops = solution.closed_loops
    loop = closed_loops.with_gain(ball_matrix(K))
    T, T_inverse = closed_loops.columns(np.eye(len(loop))), closed_loops.rows(identity(len(loop)))
    B = closed_loops.columns(solution.game.B)
    forcing_in_new_states = inputs.through(B) + exact.forcing.through(T)
    return particular(loop, forcing_in_new_states).through(T_inverse)


#: Usual time over which means are computed, s.
DURATION = 20.0


@dataclass(frozen=True, eq=False, repr=False)
class Tracking(Result, Reported):
    """Policy u = -K z + u_d(t) of a game that tracks a reference x_d(t), with z = x - x_d.

    All errors and costs are those of the linear model without disturbance, after the transients.

    exact: feedforward of the game
    K: gain of the feedback, (m, n)
    duration: time over which means are computed, s
    trims: trims at each commanded value, at the constant values together, and at all together. A
        ramp has its value at the end of the duration, and a sine its mean.
    """

    exact: Feedforward
    K: Matrix
    duration: float
    trims: tuple[CommandedTrim, ...] = ()

    @property
    def game(self) -> Game:
        """The game of regulation."""
        return self.exact.game

    @property
    def inputs(self) -> Waveform:
        """Feedforward u_d(t), (m,)."""
        return self.exact.inputs

    @property
    def cost_per_second(self) -> float:
        """Cost of u = -K z + u_d(t) per second after the transients, the mean over `duration`."""
        return self._cost(self.late_error(self.inputs), self.inputs)

    @property
    def cost_per_second_without_feedforward(self) -> float:
        """Cost of u = -K z per second after the transients, the mean over `duration`."""
        no_feedforward = constant(np.zeros(len(self.K)))
        return self._cost(self.late_error(no_feedforward), no_feedforward)

    @property
    def rms_errors(self) -> Vector:
        """Root mean square of each late error, (n,)."""
        return self._rms(self.late_error(self.inputs))

    @property
    def rms_errors_without_feedforward(self) -> Vector:
        """Root mean square of each late error with u = -K z, (n,)."""
        return self._rms(self.late_error(constant(np.zeros(len(self.K)))))

    @property
    def reachable(self) -> bool | None:
        """Whether the aircraft has a trim at the constant commands and at the end of ramps.

        None if this is unknown: without an aircraft, or for a state that is no variable of a trim.
        """
        if self._deciding_trim is None:
            reference = self.exact.reference
            return None if (reference.varies | (reference.constant != 0.0)).any() else True
        return self._deciding_trim.is_reachable

    def late_error(self, inputs: Waveform) -> Waveform:
        """Return the error z(t), (n,), of u = -K z + inputs after the transients.

            z' = (A - B K) z + B inputs + r

        inputs: (m,)
        """
        return late_error(self.exact, self.K, inputs)

    def _rms(self, error: Waveform) -> np.ndarray:
        """Return the root mean square of each channel over `duration`, (n,)."""
        return np.sqrt(np.diag(error.moments(self.duration)))

    def _cost(self, error: Waveform, inputs: Waveform) -> float:
        """Return the mean cost rate over `duration` of z = error and u = inputs - K z."""
        m, n = self.K.shape
        z_and_u = error.through(np.vstack([np.eye(n), -self.K]))
        z_and_u += inputs.through(np.vstack([np.zeros((n, m)), np.eye(m)]))
        return float((self.game.weights * z_and_u.moments(self.duration)).sum())

    @property
    def _deciding_trim(self) -> CommandedTrim | None:
        """Trim that decides `reachable`: at the constant commands, at all if none is constant.

        None without an aircraft.
        """
        if not self.trims:
            return None
        steady = _steady(self.game.names.states, self.exact.reference, self.duration)
        for trim in self.trims:
            if set(trim.command) == set(steady):
                return trim
        return self.trims[-1]

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "K": self.K,
            "duration": self.duration,
            "trims": self.trims,
            "cost_per_second": self.cost_per_second,
            "cost_per_second_without_feedforward": self.cost_per_second_without_feedforward,
            "rms_errors": self.rms_errors,
            "rms_errors_without_feedforward": self.rms_errors_without_feedforward,
            "reachable": self.reachable,
        }

    def report(self) -> Report:
        """Return a report of the errors, the costs and the trims at the commands."""
        names = self.game.names
        columns = (
            self._rms(self.exact.reference),
            self.rms_errors,
            self.rms_errors_without_feedforward,
        )
        rows = []
        for state, unit, *values in zip(names.states, names.state_units, *columns, strict=True):
            numbers = (shown_value(float(value), unit, ".3g") for value in values)
            rows.append((state, shown_unit(unit), *numbers))
        return Report(
            title=f"Tracking: reachable: {self._reachable_text()}",
            parts=(
                f"Linear model without disturbance, after the transients, over"
                f" {self.duration:g} s:\ncost per second {self.cost_per_second:.6g}, without"
                f" feedforward {self.cost_per_second_without_feedforward:.6g}",
                Table(("rms of", "unit", "command", "error", "without feedforward"), rows),
                *self.trim_parts(),
            ),
            data=storable(self),
        )

    def _reachable_text(self) -> str:
        """Return whether the commands are reachable, with the reason: "yes, as a trim of ..."."""
        deciding_trim = self._deciding_trim
        if deciding_trim is None:
            return "yes, the trim" if self.reachable else "unknown, without a trimmed aircraft"
        if deciding_trim.unheld:
            return f"unknown, {deciding_trim.unheld} is no variable of a trim"
        if deciding_trim.is_reachable:
            reference = self.exact.reference
            at = f" at {self.duration:g} s" if reference.slope.any() else ""
            mean = ", for the means of the sines" if reference.harmonics else ""
            return f"yes, as a trim of the aircraft{at}{mean}"
        return f"no ({self._need_text(deciding_trim)})"

    def _need_text(self, deciding_trim: CommandedTrim) -> str:
        """Return the largest variable beyond its limit, "elevator_center needs -71 deg, limit -30
        deg and 1 more", or why there is no trim.
        """
        if deciding_trim.reason:
            return deciding_trim.reason.removeprefix("no trim: ")
        name = next(iter(deciding_trim.beyond))
        describe = deciding_trim.model.describe
        more = f" and {len(deciding_trim.beyond) - 1} more" if len(deciding_trim.beyond) > 1 else ""
        return (
            f"{name} needs {describe(name, deciding_trim.needed[name])}, limit"
            f" {describe(name, deciding_trim.beyond[name])}{more}"
        )

    def trim_parts(self) -> tuple[Table | str, ...]:
        """Return a table of the trims at the commands, () without an aircraft.

        A column is a trim: at one command alone, or at several or all commands together. A row is
        a free variable; ! marks a value beyond its limit.
        """
        if not self.trims:
            return ()
        free_variables = dict.fromkeys(name for trim in self.trims for name in trim.needed)
        rows = [_needed_row(name, self.trims) for name in free_variables]
        words = {True: "yes", False: "no", None: "unknown"}
        verdicts = (words[trim.is_reachable] for trim in self.trims)
        table = Table(
            ("trim at", "unit", *_column_titles(self.trims)),
            [*rows, ("reachable", "", *verdicts)],
        )
        if any(trim.beyond for trim in self.trims):
            return table, "! beyond its limit"
        return (table,)


def _column_titles(trims: Sequence[CommandedTrim]) -> list[str]:
    """Return the commands of each trim, or "all" for several that are all commands."""
    commands = {name for trim in trims for name in trim.command}
    return [
        "all" if len(trim.command) > 1 and set(trim.command) == commands else " ".join(trim.command)
        for trim in trims
    ]


def _needed_row(name: str, trims: Sequence[CommandedTrim]) -> tuple[str, ...]:
    """Return the name of a variable, its unit, and the value that each trim needs, "" for none."""
    unit = trims[0].model.unit(name)
    values = []
    for trim in trims:
        value = trim.needed.get(name)
        mark = "!" if name in trim.beyond else ""
        values.append("" if value is None else shown_value(value, unit, ".4g") + mark)
    return name, shown_unit(unit), *values


def track(
    linear: LinearModel,
    solution: Solution,
    reference: Mapping[str, float | str] | Waveform,
    *,
    K: np.ndarray | None = None,
    duration: float = DURATION,
) -> Tracking:
    """Return the exact feedforward for a reference of the states, with what it costs and needs.

    The policy is u = -K (x - x_d) + u_d(t). A trim of the aircraft at the commanded values says
    whether constant commands are reachable.

    linear: the linear model of the game
    solution: exact solution of the game
    reference: state -> deviation from the trim, in the units of the model: a number, or a sum of
        terms of t in s such as "7+0.01t+2sin(0.5t)"
    K: gain of the feedback, (m, n), by default that of the solution
    duration: time over which means are computed, s

    Raises BadInputError for an unknown state, another text, a duration that is not positive, or a
    K with which A - B K is not Hurwitz.

    >>> import hfa, numpy as np
    >>> linear = hfa.paper.level_model(hfa.aircraft(), np.radians(15.0))
    >>> solution = hfa.solve(hfa.paper.published_game(linear))
    >>> hfa.track(linear, solution, {"dihedral": 0.1}).reachable
    True
    """
    refuse_unless_positive("the duration", duration)
    if not isinstance(reference, Waveform):
        channels = {}
        for name, value in reference.items():
            refuse_unknown("unknown state", name, linear.states)
            if not isinstance(value, str):
                value = f"{float(value):.17g}" if is_finite(value) else shown(value)
            channels[name] = channel(value)
        reference = stacked(channels, linear.states)
    gain = solution.K if K is None else solution.game.checked_gain(K)
    return tracked(linear, solution, gain, reference, duration)


def tracked(
    linear: LinearModel,
    solution: Solution,
    K: np.ndarray,
    reference: Waveform,
    duration: float = DURATION,
) -> Tracking:
    """Return the tracking of a reference of the states, (n,), by a policy with the gain K.

    solution: exact solution of the game
    K: (m, n)

    Raises BadInputError unless A - B K is proved Hurwitz.
    """
    exact = feedforward(solution, reference)
    if not stabilizes(solution.game, K):
        abscissa = solution.closed_loops.poles(K).real.max()
        raise BadInputError(
            f"tracking: A - B K has abscissa {abscissa:+.4g} 1/s; give a K that stabilizes the game"
        )
    return Tracking(exact, K, duration, _commanded_trims(linear, reference, duration))


def _steady(states: Sequence[str], reference: Waveform, duration: float) -> dict[str, float]:
    """Return the commands that are constant or a ramp and not 0, state -> deviation at the end."""
    values = (reference.constant + reference.slope * duration).tolist()
    rows = zip(states, values, reference.oscillates, strict=True)
    return {name: value for name, value, waves in rows if value != 0.0 and not waves}


def _commanded_trims(
    linear: LinearModel, reference: Waveform, duration: float
) -> tuple[CommandedTrim, ...]:
    """Return the trims at each command, at those without sines together, and at all together."""
    point = linear.point
    if point is None or point.found_by is None:
        return ()
    values = (reference.constant + reference.slope * duration).tolist()
    rows = zip(linear.states, values, reference.varies, strict=True)
    commands = {name: value for name, value, moves in rows if value or moves}
    steady = _steady(linear.states, reference, duration)
    groups = [{name: value} for name, value in commands.items()]
    for several in (steady, commands):
        if several and several not in groups:
            groups.append(several)
    return tuple(commanded_trim(point, group) for group in groups)
