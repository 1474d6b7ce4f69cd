"""A renderer of wheels under a light grid: tyre, projectors, optics, scene and truth.

Made to test a measuring chain: surfaces and their normals are exact, images have no systematic sub-pixel
shift, and everything random comes from the generator that the caller hands in.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
