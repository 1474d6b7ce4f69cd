"""How compiled functions are declared: numba's decorators, with a disk cache that notices every change.

Numba keeps compiled code as long as the function's own file stays the same, although code of other files is
compiled into it. After an update of one file a stale kernel would go on measuring as before. The locator here
stamps a kernel with the content of all files of this project that it can reach.

The cache is a convenience and never a reason to fail: where nothing can be written, or what was written
cannot be read, a kernel is compiled again, and `UNSAVED` says so.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
from numba import config, prange
from numba.core.caching import (
    FunctionCache,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

__all__ = ["KERNELS", "UNSAVED", "njit", "on_one_core", "prange"]

KERNELS: dict[str, Any] = {}
"""Every compiled function of the modules that were imported, by module and name."""
UNSAVED: dict[str, str] = {}
"""Kernels whose compiled code could not be kept on the disk since the program started, and why."""

_Function = TypeVar("_Function", bound=Callable[..., Any])
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


def _given_folder() -> str:
    return str(config.CACHE_DIR)  # type: ignore[attr-defined]


class _WholeStamp:
    """Mixin: the stamp covers every file that the function reaches, and a folder may be read-only."""

    def __init__(self, function: Any, path: str) -> None:
        super().__init__(function, path)  # type: ignore[call-arg]
        self._globals, self._path = function.__globals__, path

    @classmethod
    def from_function(cls, function: Any, path: str) -> Any:
        """Return a locator, or None where the folder can neither be written nor holds this function."""
        found = super().from_function(function, path)  # type: ignore[misc]
        if found is None and (cls is not GivenFolder or _given_folder()):
            here = cls(function, path)
            name = f"*.{function.__qualname__}-{function.__code__.co_firstlineno}.*.nbi"
            found = here if any(Path(here.get_cache_path()).glob(name)) else None  # type: ignore[attr-defined]
        return found

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


class Nowhere(_WholeStamp, UserProvidedCacheLocator):
    """A folder that cannot be: where no other place can be written, each start compiles anew."""

    def get_cache_path(self) -> str:
        """Return a path at which no file can be made."""
        return os.devnull

    @classmethod
    def from_function(cls, function: Any, path: str) -> Nowhere:
        """Return one for every function."""
        return cls(function, path)


config.CACHE_LOCATOR_CLASSES = ",".join(  # type: ignore[attr-defined]
    f"{__name__}.{kind.__name__}" for kind in (GivenFolder, InTree, UserWide, Nowhere)
)
# OpenMP first: several threads of the station may call at once, which numba's own layer forbids, and other
# libraries bring versions of TBB that numba warns about.
config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]  # type: ignore[attr-defined]


class ForgivingCache(FunctionCache):
    """Numba's disk cache of one function, with failures of the disk turned into compiling again."""

    _cache_file: Any
    _index_key: Any

    def holds(self, signature: Any, context: Any) -> bool:
        """Whether compiled code for these types is on the disk, without loading it."""
        try:
            name = self._cache_file._load_index().get(self._index_key(signature, context.codegen()))
            return name is not None and Path(self._cache_file._data_path(name)).stat().st_size > 0
        except Exception:  # noqa: BLE001  (a pickle that is damaged raises anything)
            return False

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the compiled code, or None when there is none or it is damaged."""
        try:
            return super().load_overload(signature, context)  # type: ignore[no-untyped-call]
        except Exception:  # noqa: BLE001  (a pickle that is damaged raises anything)
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep compiled code; one process at a time, because each writes the whole index."""
        try:
            with self._locked():
                self._save(signature, compiled)
        except OSError as error:
            function = self._py_func
            UNSAVED[f"{function.__module__}.{function.__qualname__}"] = error.strerror or str(error)

    def _save(self, signature: Any, compiled: Any) -> None:
        try:
            super().save_overload(signature, compiled)  # type: ignore[no-untyped-call]
        except OSError:
            raise
        except Exception:  # noqa: BLE001  (the index is damaged: begin a new one)
            self._cache_file.flush()
            super().save_overload(signature, compiled)  # type: ignore[no-untyped-call]

    @contextmanager
    def _locked(self) -> Iterator[None]:
        folder = Path(self.cache_path)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ".lock").open("ab") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield


def njit(**options: Any) -> Callable[[_Function], _Function]:
    """Return `numba.njit` with these options; the function is registered in `KERNELS`."""
    kept = options.pop("cache", False)
    compiled = numba.njit(**options)

    def declared(function: _Function) -> _Function:
        kernel = compiled(function)
        if kept:
            kernel._cache = ForgivingCache(function)  # type: ignore[no-untyped-call]
        KERNELS[f"{function.__module__}.{function.__qualname__}"] = kernel
        return cast(_Function, kernel)

    return declared


@contextmanager
def on_one_core() -> Iterator[None]:
    """Let kernels that would share their work among all cores keep to that of the thread that calls them.

    Where several threads measure at once, each with all cores, they wait for each other and burn time.
    """
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
