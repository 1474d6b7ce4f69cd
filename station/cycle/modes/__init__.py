"""What a start may ask for beside measuring: adjusting, a sweep, images of a plate, a master check."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
