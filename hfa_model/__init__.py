"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written
symbolically."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
