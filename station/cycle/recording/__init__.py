"""What is stored of a cycle, what is still owed to the store, and what the line was told."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
