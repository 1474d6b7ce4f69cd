"""Types of compiled functions as text and back, as numba's own signatures are written."""

from __future__ import annotations

import importlib
from typing import Any

from numba import types

from alignment.kernels import KERNELS


def spell(kind: Any) -> str:
    """Return a type as text that `read` understands."""
    if isinstance(kind, types.Array) and kind.aligned:
        if not kind.mutable:
            return f"Array({spell(kind.dtype)}, {kind.ndim}, '{kind.layout}', True)"
        axes = [":"] * kind.ndim
        if kind.layout != "A":
            axes[-1 if kind.layout == "C" else 0] = "::1"
        return f"{spell(kind.dtype)}[{', '.join(axes)}]"
    if isinstance(kind, types.ListType):
        return f"ListType({spell(kind.item_type)})"
    if isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        whose = kind.instance_class
        return f"named('{whose.__module__}.{whose.__qualname__}', {', '.join(map(spell, kind.types))})"
    if isinstance(kind, types.UniTuple):
        return f"UniTuple({spell(kind.dtype)}, {kind.count})"
    if isinstance(kind, types.Tuple):
        return f"Tuple(({', '.join(map(spell, kind.types))},))"
    if isinstance(kind, types.Boolean):
        return "boolean"
    return str(kind)


def spell_all(kinds: tuple[Any, ...]) -> str:
    """Return the types of all arguments as one text."""
    return "; ".join(map(spell, kinds))


def read_all(text: str) -> tuple[Any, ...]:
    """Return the types of all arguments from their text, which is this program's own table."""
    known = vars(types) | {"named": _named}
    return tuple(eval(kind, known) for kind in text.split("; "))


def _named(name: str, *kinds: Any) -> Any:
    """Return the type of a named tuple of this program."""
    module, _, of = name.rpartition(".")
    of_types: Any = types.BaseTuple.from_types
    return of_types(kinds, getattr(importlib.import_module(module), of))


def called() -> dict[str, list[str]]:
    """Return the functions that this process has compiled or loaded since it started, with their types."""
    return {
        name: [spell_all(kinds) for kinds in kernel.overloads]
        for name, kernel in KERNELS.items()
        if kernel.overloads
    }
