"""What to turn, which way, how far, and when to stop: pure logic over numbers, without clock and files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
