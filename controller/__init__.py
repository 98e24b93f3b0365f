"""How the aircraft is controlled: the game, the critics that learn its value, and the simulated
closed loop."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
