"""A calibration's life: made with the plate, checked, put in the vehicle frame, refreshed, zeroed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
