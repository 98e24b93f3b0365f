"""Studies: programs that use the packages as a user would.

Studies are not installed, and no installed package imports them.
"""
