"""Proofs for every value of the scheduling variable: nothing outside but the command and studies
imports them."""
