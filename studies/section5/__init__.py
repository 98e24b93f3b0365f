"""New simulations of Section 5 of the paper, compared with its claims."""
