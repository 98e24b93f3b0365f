"""Value and policy of the nonlinear game about a trim, as power series (Al'brekht's method)."""
