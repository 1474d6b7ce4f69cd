"""The maintainer's day: cameras looked at, exposure found, plates and wheels captured."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
