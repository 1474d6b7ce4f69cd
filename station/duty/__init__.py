"""When a master check is due and what that does to the station: pure logic, no clock, threads, database."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
