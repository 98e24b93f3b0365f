"""Judgement of policies as they are deployed: many flights, the loop at the trim, the optimum."""
