"""The integrator's: monitor, conformance, scenarios, and the interface page."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
