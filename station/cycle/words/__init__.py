"""What is said: commands, states, faults, answers, and what is told of the vehicle."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
