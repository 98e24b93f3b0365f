"""What an aircraft is to every package: the declaration of a model, how it is loaded and converted."""

from .model import Model as Model
from .signals import Signal as Signal
