"""What keeps a database well: checks, backups, retention, shipping, the work beside the station."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
