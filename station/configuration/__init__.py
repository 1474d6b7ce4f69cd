"""What a station is told: its configuration, the vehicle types, and a starter to begin with."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
