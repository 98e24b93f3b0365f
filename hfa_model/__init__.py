"""The flexible aircraft of the paper: three rigid panels on two hinges, seven states, five
inputs."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
