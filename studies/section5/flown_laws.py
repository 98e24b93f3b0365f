"""The laws simulated in Section 5: what each hands to the loop, and what it learns on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from controller.game.basis import Basis, basis
from controller.laws.learn import learn
from controller.policy.learned_gain import baseline_weights, online_law
from controller.policy.policies import FlownLaw, TrackingPolicy, tracking_constants
from controller.policy.signals import Signal, zero
from controller.riccati.gare import solve_game
from controller.training_data.recording import Stack, random_pool
from hfa_model.vectors import LINEAR_STATES
from studies.section5.critic_policy import CriticPolicy, critic_law, forcing
from studies.section5.setting import PaperCase, Setting, feedforward, generator
from studies.update_law.published_law import PublishedLaw, PublishedSettings, published_law

PRINTED, MODIFIED = "published, as printed", "published, modified"
CERTIFIED, CERTIFIED_FF = "certified", "certified + feed-forward"
INTEGRAL = "integral RL"
EXACT, EXACT_FF, REWEIGHTED = "exact", "exact + feed-forward", "exact, alpha reweighted"

#: What each law is, for tables and figures.
LAWS = {
    PRINTED: "Eq. (46) with the gains of Theorem 1 and W(0) = 100",
    MODIFIED: "Eq. (46) with a stabilizing start, scaled states and gains by hand",
    CERTIFIED: "u = -K(t) z, the certified law learning in flight; a gentle LQR until K(t) is certified",
    CERTIFIED_FF: "the same, with the exact feed-forward from the first certified gain on",
    INTEGRAL: "u = -K(t) z, learned in flight by integral RL from the same gentle LQR",
    EXACT: "u = -K z with the exact solution of the game",
    EXACT_FF: "the same with the exact feed-forward: the optimum for this reference",
    REWEIGHTED: "the optimum with feed-forward after the weight of alpha was multiplied",
}


@dataclass(frozen=True, eq=False)
class Critic:
    """What a law learns. weights: (N, M), in the model's units, one row a tick; residual: (N,), relative Bellman
    residual |e|/|z'Qz| of the game over the recorded stack. note: facts of the learning by name.
    """

    basis: Basis
    weights: np.ndarray
    residual: np.ndarray
    note: dict[str, Any]


#: Learning runs that are kept: flights of a section that differ in the plant or in noise learn the same.
_REMEMBERED = 8
#: From the memory of a law at the ticks, (N, k), to what it has learned.
Learned = Callable[[np.ndarray], Critic]


def law_of(
    setting: Setting, case: PaperCase, law: str, predefined_time: float, frozen: bool, reference: Signal
) -> tuple[FlownLaw, Learned | None]:
    """The law ready to fly a case that has learned nothing yet, and how to read what it learns; None if nothing.

    predefined_time: T_w, s; frozen: whether learning stops there. reference: x_d, of which feed-forward and the
    published drift know.
    """
    if law in (PRINTED, MODIFIED):
        return _published(setting, case, law, predefined_time, frozen, reference)
    if law in (CERTIFIED, CERTIFIED_FF, INTEGRAL):
        return _learned(setting, case, law, predefined_time, reference)
    tuned = case.reweighted(setting.configuration.reweighted.alpha_factor) if law == REWEIGHTED else case
    w = generator(reference)
    F = np.zeros((len(case.game.R), w.size)) if law == EXACT else feedforward(tuned, reference)
    return FlownLaw(law, TrackingPolicy(w), tracking_constants(tuned.exact.K, F)[None], np.zeros(0)), None


def recorded_pool(setting: Setting, case: PaperCase) -> Stack:
    """The random states from which the stack of every critic is chosen."""
    critic = setting.configuration.critic
    return random_pool(case.game, critic.pool, critic.seed, np.array(critic.box))


@lru_cache(maxsize=_REMEMBERED)
def published(setting: Setting, case: PaperCase, law: str, predefined_time: float) -> PublishedLaw:
    """Eq. (46) on the recorded stack, as printed or modified."""
    configuration = setting.configuration
    critic, printed, modified = (
        configuration.critic,
        configuration.published_as_printed,
        configuration.published_modified,
    )
    if law == MODIFIED:
        start_game = replace(case.game, Q=modified.start_Q * np.eye(len(LINEAR_STATES)), delta=np.inf)
        functions = basis(modified.basis, len(LINEAR_STATES))
        start: Any = tuple(functions.weights(solve_game(start_game).P).tolist())
        gains = (modified.alpha1, modified.alpha2)
    else:
        functions, start, gains = basis(critic.basis, len(LINEAR_STATES)), printed.initial_weight, None
    chosen = PublishedSettings(
        predefined_time=predefined_time,
        step=configuration.flight.step,
        theta=critic.theta,
        basis=functions.name,
        samples=critic.samples,
        initial_weights=start,
        recorded_weights=start,
        normalisation=critic.normalisation,
        gains=gains,
        coordinates=modified.coordinates if law == MODIFIED else printed.coordinates,
    )
    return published_law(case.game, chosen, critic.seed, recorded_pool(setting, case))


def _published(
    setting: Setting, case: PaperCase, name: str, predefined_time: float, frozen: bool, reference: Signal
) -> tuple[FlownLaw, Learned]:
    law = published(setting, case, name, predefined_time)
    configuration = setting.configuration
    own = configuration.published_modified if name == MODIFIED else configuration.published_as_printed
    told = forcing(case.game.A, reference) if own.drift == "with reference" else zero(len(LINEAR_STATES))
    learning = int(np.ceil(predefined_time / setting.configuration.flight.tick - 1e-9))
    ticks = np.arange(learning + 1 if frozen else 1)

    def critic(memory: np.ndarray) -> Critic:
        weights = np.array([law.equations.unscaled(row) for row in memory])
        residual = np.array([law.equations.reported_residuals(row)["residual_norm"] for row in memory])
        facts = law.theorem._asdict() | {"alpha1": law.gains[0], "alpha2": law.gains[1]}
        return Critic(law.basis, weights, residual, facts | {"explicit_step_limit": law.explicit_step_limit})

    flown = critic_law(name, CriticPolicy(law, told))
    return replace(flown, table=(ticks < learning).astype(float)[:, None]), critic


def _learned(
    setting: Setting, case: PaperCase, law: str, predefined_time: float, reference: Signal
) -> tuple[FlownLaw, Learned]:
    """K(t) from a learning run that goes on beside the flight; a baseline is used until K(t) is certified."""
    tick = setting.configuration.flight.tick
    plan = (
        _integral_plan(setting, case, tick)
        if law == INTEGRAL
        else _certified_plan(setting, case, predefined_time, tick)
    )
    assert plan.learned is not None
    learned, w = plan.learned, generator(reference)
    none = np.zeros((len(case.game.R), w.size))
    F = feedforward(case, reference) if law == CERTIFIED_FF else none

    started = tick * np.arange(len(plan.gains)) >= plan.certified_from - 1e-9
    table = [tracking_constants(K, F if begun else none) for K, begun in zip(plan.gains, started, strict=True)]

    def critic(memory: np.ndarray) -> Critic:
        rows = np.searchsorted(learned.times, tick * np.arange(len(memory)) + 1e-9, side="right") - 1
        rows = np.clip(rows, 0, len(learned.times) - 1)
        facts = {"status": learned.outcome, "learned_from": plan.certified_from} | learned.diagnostics
        functions = basis(learned.basis, len(LINEAR_STATES))
        return Critic(functions, learned.weights[rows], learned.residual_norm[rows], facts)

    return FlownLaw(law, TrackingPolicy(w), np.array(table), np.zeros(0), {}, plan.certified_from, learned), critic


@lru_cache(maxsize=_REMEMBERED)
def _certified_plan(setting: Setting, case: PaperCase, predefined_time: float, tick: float) -> FlownLaw:
    critic = setting.configuration.critic
    learned = learn(
        case.game,
        "certified",
        critic.seed,
        pool=recorded_pool(setting, case),
        predefined_time=predefined_time,
        tick=tick,
        theta=critic.theta,
        basis=critic.basis,
        samples=critic.samples,
        initial_weights=setting.configuration.published_as_printed.initial_weight,
    )
    return online_law(case.game, "certified", learned, tick)


@lru_cache(maxsize=_REMEMBERED)
def _integral_plan(setting: Setting, case: PaperCase, tick: float) -> FlownLaw:
    chosen = asdict(setting.configuration.irl)
    start = baseline_weights(case.game)
    learned = learn(case.game, "irl", setting.configuration.critic.seed, initial_weights=start, **chosen)
    return online_law(case.game, "irl", learned, tick)
