"""Training of policies by Stable-Baselines3 with its default settings."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import hfa
from studies.finished import finished, stamped
from studies.gap.tasks import Task, deployment_of

#: Algorithm -> (number of environment steps, number of parallel episodes).
BUDGETS: Mapping[str, tuple[int, int]] = {
    "PPO": (200_000, 8),
    "A2C": (200_000, 8),
    "SAC": (15_000, 1),
    "TD3": (8_000, 1),
}
#: Duration of an episode, s.
SECONDS = 20.0


@dataclass(frozen=True)
class Run:
    """One training run.

    task: the aircraft
    algorithm: algorithm of Stable-Baselines3
    seed: seed of the network, the noise and the initial conditions
    folder: folder of its files
    """

    task: Task
    algorithm: str
    seed: int
    folder: Path

    @property
    def name(self) -> str:
        """Name of the run in file names."""
        words = [*self.task.name.replace(",", "").replace("/", " ").split(), self.algorithm]
        return "-".join([*words, str(self.seed)])

    @property
    def policy(self) -> Path:
        """Path of the policy, a zip of Stable-Baselines3."""
        return self.folder / f"{self.name}.zip"

    @property
    def record(self) -> Path:
        """Path of the JSON record of the training."""
        return self.folder / f"{self.name}.json"

    def decides(self) -> dict[str, Any]:
        """Return the settings that determine the policy, without the versions of the libraries."""
        steps, episodes = BUDGETS[self.algorithm]
        return {
            "aircraft": self.task.aircraft,
            "hold": dict(self.task.hold),
            "algorithm": self.algorithm,
            "seed": self.seed,
            "steps": steps,
            "episodes": episodes,
            "seconds": SECONDS,
        }

    def trained(self) -> dict[str, Any] | None:
        """Return the record of a finished training with the same settings, or None."""
        if not self.policy.exists():
            return None
        return finished(self.record, self.decides())

    def train(self) -> dict[str, Any]:
        """Train the policy, store the policy and its record, and return the record."""
        import stable_baselines3
        import torch
        from stable_baselines3.common.vec_env import VecNormalize

        from hfa_support.files import write_text
        from hfa_support.reporting.data_files import json_text

        torch.set_num_threads(1)
        steps, episodes = BUDGETS[self.algorithm]
        point = self.task.point()
        flights = hfa.vector_environment(
            point.model, deployment_of(point), [point], count=episodes, seconds=SECONDS
        )
        normalized = VecNormalize(flights, norm_obs=False, norm_reward=True)
        learner = getattr(stable_baselines3, self.algorithm)(
            "MlpPolicy", normalized, seed=self.seed
        )
        began = time.process_time()
        learner.learn(steps)
        processor = time.process_time() - began
        self.folder.mkdir(parents=True, exist_ok=True)
        learner.save(self.policy)
        content = {
            **self.decides(),
            "processor_seconds": round(processor, 1),
            "policy_sha256": hashlib.sha256(self.policy.read_bytes()).hexdigest(),
            "stable_baselines3": stable_baselines3.__version__,
            "torch": torch.__version__,
        }
        record = stamped(content, self.decides())
        write_text(self.record, json_text(record))
        return record
