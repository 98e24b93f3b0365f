"""The paper's flexible aircraft: three rigid panels, two hinges, seven states, five inputs."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
