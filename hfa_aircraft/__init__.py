"""What an aircraft is to every package: the declaration of a model, how it is loaded and
converted."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
