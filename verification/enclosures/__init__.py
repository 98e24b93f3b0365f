"""Ball arithmetic: the model, its trims, its games and the signs of eigenvalues, enclosed."""

from verification.arithmetic import flint_or_refusal

flint_or_refusal()
