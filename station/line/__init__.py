"""The line interface: CAN messages of the DBC, buses, the PLC simulator, the monitor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
