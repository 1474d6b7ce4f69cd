"""How the cameras are: figures of every shot, warned of before they stop a wheel, kept as trends."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
