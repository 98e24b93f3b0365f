"""Statements about every angle of an interval, proved with ball arithmetic."""

from verification.arithmetic import flint_or_refusal

flint_or_refusal()
