"""A station with prepared shots, and controllers for it: the line tried out without cameras."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
