"""Which compiled functions each work needs, whether the disk holds them, and loading them."""

from __future__ import annotations

import enum
import importlib
import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from alignment.errors import WarmUpError
from alignment.kernels import KERNELS
from station.warm_up.notation import read_all
from station.warm_up.table import SIGNATURES


class Work(enum.StrEnum):
    """Work that needs compiled functions; the words of the table."""

    MEASURE_8 = "measure_8"
    MEASURE_16 = "measure_16"
    SPIN = "spin"
    REFRESH = "refresh"
    CALIBRATE = "calibrate"
    WHEEL_IMAGES = "wheel_images"
    DEFORMED_WHEEL_IMAGES = "deformed_wheel_images"
    PLATE_IMAGES = "plate_images"


@dataclass(frozen=True)
class Needed:
    """One function for arguments of these types, as `station.warm_up.notation` spells them."""

    name: str
    signature: str


def needed(works: Iterable[Work]) -> tuple[Needed, ...]:
    """Return what these works need, the longest to compile first, each once."""
    found = {
        Needed(name, signature)
        for work in works
        for name, signatures in SIGNATURES.get(work, {}).items()
        for signature in signatures
    }
    return tuple(sorted(found, key=lambda one: (-weight(one), one.name, one.signature)))


def weight(one: Needed) -> int:
    """Return a measure of how long a function takes to compile: the code that it reaches, bytes."""
    seen: set[int] = set()
    return _reached(_kernel(one.name), seen)


def _reached(kernel: Any, seen: set[int]) -> int:
    if id(kernel) in seen:
        return 0
    seen.add(id(kernel))
    function = inspect.unwrap(kernel.py_func)
    code, known = function.__code__, function.__globals__
    size = len(code.co_code)
    values = [known.get(name) for name in code.co_names]
    for module in [value for value in values if isinstance(value, ModuleType)]:
        values += [getattr(module, name, None) for name in code.co_names]
    return size + sum(_reached(value, seen) for value in values if hasattr(value, "py_func"))


def is_kept(one: Needed) -> bool:
    """Whether the disk holds the compiled code, or this process has it already."""
    kernel, types = _kernel(one.name), read_all(one.signature)
    return bool(types in kernel.overloads or kernel._cache.holds(types, kernel.targetctx))


def missing(works: Iterable[Work]) -> tuple[Needed, ...]:
    """Return what these works need and the disk does not hold."""
    return tuple(one for one in needed(works) if not is_kept(one))


def load(one: Needed) -> bool:
    """Load a function from the disk or compile it; whether it was compiled.

    Raises
    ------
    WarmUpError
        When it does not compile.
    """
    kernel, types = _kernel(one.name), read_all(one.signature)
    before = sum(kernel.stats.cache_misses.values())
    try:
        kernel.compile(types)
    except Exception as error:
        reason = next(iter(str(error).splitlines()), type(error).__name__)
        raise WarmUpError(
            f"the function {one.name} was not compiled: {reason}; install the program again with the "
            "versions of requirements.lock, and report it if that does not help"
        ) from error
    return bool(sum(kernel.stats.cache_misses.values()) > before)


def _kernel(name: str) -> Any:
    if name not in KERNELS:
        importlib.import_module(name.rsplit(".", 1)[0])
    try:
        return KERNELS[name]
    except KeyError:
        raise WarmUpError(
            f"the table of compiled functions names {name}, which there is not; write it anew with "
            "tools/kernel_table.py"
        ) from None
