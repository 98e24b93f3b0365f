"""Games in discrete time: their exact solution, critics of them, and Q-learning."""
