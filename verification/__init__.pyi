"""Is it true: the exact game solution with its certificate, and everything that is checked against
it."""

from hfa_discrete.solution import solve_discounted as solve_discounted
from hfa_networks.files.network import from_network as from_network
from hfa_proof.checker.checker import check_certificate as check_certificate
from hfa_proof.search.family import Family as Family
from hfa_proof.search.models_grid import prove_models as prove_models
from hfa_proof.search.schedule_proof import prove_schedule as prove_schedule
from hfa_proof.search.solution_proof import (
    prove_critic as prove_critic,
    prove_solution as prove_solution,
)
from hfa_servo.generalized_plant import (
    GeneralizedPlant as GeneralizedPlant,
    solve_plant as solve_plant,
)

from .critic.critic_check import (
    check_critic as check_critic,
)
from .critic.critic_errors import relative_error as relative_error
from .critic.history import check_history as check_history
from .critic.scope import Scope as Scope
from .critics import (
    from_gain as from_gain,
    from_value as from_value,
    from_weights as from_weights,
)
from .exact_solution import (
    analyse_game as analyse_game,
    bounded_real_gain as bounded_real_gain,
    disk_margin as disk_margin,
    minimum_delta as minimum_delta,
    solve_game as solve_game,
    solve_games as solve_games,
)
from .regeneration import regenerate_all as regenerate_all
