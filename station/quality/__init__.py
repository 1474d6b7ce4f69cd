"""What the quality engineer asks: gauge studies and reports, from statistics and the result database."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
