"""A policy as it is deployed: what it observes, what its actions move, when; and whether it
flies."""
