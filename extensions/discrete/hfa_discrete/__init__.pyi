"""Games in discrete time: their exact solution, critics of them, and Q-learning."""

from .solution import solve_discounted as solve_discounted
