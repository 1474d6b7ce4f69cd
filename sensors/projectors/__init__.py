"""The light of a rig: a protocol, drivers by entry point, and rigs whose projector is a device of theirs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
