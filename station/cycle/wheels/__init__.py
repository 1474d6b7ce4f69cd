"""One wheel at a time: from its armed rig over its exposures to a measurement, or the reason of none."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
