"""Operating points, exact linear models, modes, sweeps, and the aircraft's identification."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
