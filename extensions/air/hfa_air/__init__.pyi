"""Air with mass and memory: the `unsteady` dynamics of the highly flexible aircraft."""

from .unsteady import UNSTEADY as UNSTEADY
