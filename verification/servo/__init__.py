"""Servos in flight with faults: those of SimVFA from their formulas, those of this package, and what came out."""
