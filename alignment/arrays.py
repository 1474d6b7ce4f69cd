"""Names of array types; shapes, units and frames stand where an array is made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers of double precision, in which everything is computed."""
Singles = NDArray[np.float32]
"""Numbers of single precision, where an image is filtered."""
Index = NDArray[np.int64]
"""Whole numbers that count or point."""
Mask = NDArray[np.bool_]
"""Yes or no for each element."""
