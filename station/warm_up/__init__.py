"""Compiles what a work needs before it begins, so that no measurement waits for a compiler.

Others use `warm_up` (everything compiled, in processes of its own), `missing` and the works of `kernels`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
