"""Proofs for every value of the scheduling variable: nothing outside but the command and studies
imports them."""

from .checker.checker import check_certificate as check_certificate
from .search.family import Family as Family
from .search.models_grid import prove_models as prove_models
from .search.schedule_proof import prove_schedule as prove_schedule
