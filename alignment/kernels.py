"""How compiled functions are declared: numba's decorators, with a disk cache that notices every change.

Numba keeps compiled code as long as the function's own file stays the same, although code of other files is
compiled into it. After an update of one file a stale kernel would go on measuring as before. The locator here
stamps a kernel with the content of all files of this project that it can reach.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from numba import config, njit, prange
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

__all__ = ["njit", "prange"]

_ROOT = Path(__file__).resolve().parents[1]
_OURS = tuple(str(_ROOT / package) for package in ("alignment", "sensors"))


@cache
def _content(path: str) -> bytes:
    return hashlib.sha256(Path(path).read_bytes()).digest()


def _reach(names: dict[str, Any], path: str, seen: set[str]) -> None:
    """Collect the files of this project whose functions code with these global names may call."""
    if path in seen or not path.startswith(_OURS):
        return
    seen.add(path)
    for value in list(names.values()):
        if isinstance(value, ModuleType):
            _reach(vars(value), getattr(value, "__file__", None) or "", seen)
        elif isinstance(function := getattr(value, "py_func", None), FunctionType):
            _reach(function.__globals__, function.__code__.co_filename, seen)


class _WholeStamp:
    """Mixin: the stamp covers every file that the function reaches."""

    def __init__(self, function: Any, path: str) -> None:
        super().__init__(function, path)  # type: ignore[call-arg]
        self._globals, self._path = function.__globals__, path

    def get_source_stamp(self) -> bytes:
        """Hash of all contents, in the order of the paths."""
        seen: set[str] = set()
        _reach(self._globals, self._path, seen)
        files = sorted(seen | {self._path})
        return hashlib.sha256(b"".join(_content(path) for path in files)).digest()


class GivenFolder(_WholeStamp, UserProvidedCacheLocator):
    """In the folder of ``NUMBA_CACHE_DIR``."""


class InTree(_WholeStamp, InTreeCacheLocator):
    """Beside the source."""


class UserWide(_WholeStamp, UserWideCacheLocator):
    """In the user's cache folder, where the source is read-only."""


config.CACHE_LOCATOR_CLASSES = ",".join(  # type: ignore[attr-defined]
    [f"{__name__}.{kind.__name__}" for kind in (GivenFolder, InTree, UserWide)]
    + ["IPythonCacheLocator", "ZipCacheLocator"]
)
# OpenMP first: several threads of the station may call at once, which numba's own layer forbids, and other
# libraries bring versions of TBB that numba warns about.
config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]  # type: ignore[attr-defined]
