"""What all packages share: errors, files, reports, jobs and native code."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
