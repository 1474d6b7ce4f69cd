"""The accuracy studies: each repeats an experiment many times and sets what comes out beside its goal."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
