"""Zero-sum games, their exact solution, critics and learners."""

from .critic.critic_file import critic_in as critic_in
from .game.basis import basis as basis
from .hfa_files import load_game as load_game
from .learning.recording import Stack as Stack, random_pool as random_pool, record as record
from .learning.ticks import run as run
from .riccati.margins import disk_margin as disk_margin
from .riccati.meaning import bounded_real_gain as bounded_real_gain
from .riccati.smallest_delta import minimum_delta as minimum_delta
