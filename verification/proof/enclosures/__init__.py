"""Ball arithmetic: the model, its trims, its games and the signs of eigenvalues, enclosed."""
