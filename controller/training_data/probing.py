"""A probing flight, exact to rounding: the linear plant driven by sums of sines in every input and disturbance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.game.zero_sum import Game

#: Sines per channel. n(n+1)/2 products of states must be told apart; m + k channels with three sines each do.
SINES = 3
#: Range of their frequencies, rad/s.
BAND = (0.5, 12.0)


@dataclass(frozen=True, eq=False)
class ProbingFlight:
    """z' = A z + B u + E d, u = C_u w, d = C_d w, w' = Ω w: one linear system for ξ = [z; w].

    generator: (N, N), ξ' = generator ξ. start: (N,), ξ(0). input_map (m, N), disturbance_map (k, N).
    """

    generator: np.ndarray
    start: np.ndarray
    input_map: np.ndarray
    disturbance_map: np.ndarray
    states: int

    @classmethod
    def design(
        cls,
        game: Game,
        seed: int,
        *,
        input_amplitude: float,
        disturbance_amplitude: float,
        half_widths: np.ndarray,
    ) -> ProbingFlight:
        """Every channel gets `SINES` sines of random phase, frequencies spread over `BAND`; z(0) is random in a box.

        half_widths: (n,), of the box of z(0); the offset excites the slow modes that the sines leave alone.
        """
        rng = np.random.default_rng(seed)
        n, m, k = game.A.shape[0], game.B.shape[1], game.E.shape[1]
        count = SINES * (m + k)
        frequencies = rng.permutation(np.linspace(*BAND, count)) * rng.uniform(0.97, 1.03, count)
        phases = rng.uniform(0.0, 2.0 * np.pi, count)
        amplitudes = np.repeat([input_amplitude] * m + [disturbance_amplitude] * k, SINES) / SINES
        pick = np.zeros((m + k, n + 2 * count))
        for wave in range(count):
            pick[wave // SINES, n + 2 * wave] = amplitudes[wave]
        generator = np.zeros((n + 2 * count, n + 2 * count))
        generator[:n, :n] = game.A
        generator[:n] += game.B @ pick[:m] + game.E @ pick[m:]
        for wave, frequency in enumerate(frequencies):
            block = slice(n + 2 * wave, n + 2 * wave + 2)
            generator[block, block] = [[0.0, frequency], [-frequency, 0.0]]
        oscillators = np.column_stack([np.cos(phases), np.sin(phases)]).reshape(-1)
        return cls(
            generator, np.concatenate([rng.uniform(-half_widths, half_widths), oscillators]), pick[:m], pick[m:], n
        )

    def extended(self, times: np.ndarray) -> np.ndarray:
        """ξ(t) = exp(generator t) ξ(0), (N_t, N)."""
        from scipy.linalg import expm

        times = np.asarray(times, dtype=float)
        steps = np.diff(times, prepend=0.0)
        propagators: dict[float, np.ndarray] = {}
        current, rows = self.start, []
        for step in np.round(steps, 12):
            if step not in propagators:
                propagators[step] = expm(self.generator * step)
            current = propagators[step] @ current
            rows.append(current)
        return np.array(rows)

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States (N_t, n), inputs (N_t, m) and disturbances (N_t, k) at increasing times."""
        extended = self.extended(times)
        return extended[:, : self.states], extended @ self.input_map.T, extended @ self.disturbance_map.T
