"""Section 5 of the paper, simulated again: its statements, the measured numbers, and their
agreement.
"""
