"""The overflow of the paper's update law, Eq. (46), and a learning law of a user of the
packages.
"""
