"""Quality statistics: capability, control charts, gauge studies, uncertainty budgets.

Pure functions: numbers in, frozen values out; no database, no files, no clock, no units of their own. What
goes in as degrees comes out as degrees.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
