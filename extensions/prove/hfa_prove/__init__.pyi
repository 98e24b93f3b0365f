"""Proofs and their checkers."""

from .check import check_certificate as check_certificate
from .search.family import Family as Family
from .search.schedule import prove_schedule as prove_schedule
