"""Search for the reason why a critic is wrong.

The reason is a mistake, or another game of which the critic is the solution.
"""
