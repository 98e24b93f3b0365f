from hfa_prove.search.schedule import (
    Family as Family,
    breakpoints_of as breakpoints_of,
    exact_gains as exact_gains,
    prove_schedule as prove_schedule,
)
from hfa_prove.statements.schedule import Gains as Gains
