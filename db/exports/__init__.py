"""Results for other programs and for paper: Q-DAS AQDEF, CSV, Parquet, PDF. Angles leave in degrees."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
