"""What a measurement runs on, as far as it may decide the last bits of a result."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import alignment

CODE = "code"
"""Name of the entry that holds the hash of the program's own mathematics."""
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "opencv-python-headless", "scikit-image", "pillow")
_CPU = Path("/proc/cpuinfo")


@cache
def _known() -> dict[str, str]:
    found = {"python": platform.python_version(), "processor": _processor(), CODE: _code_hash()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    threads = os.environ.get("OPENBLAS_NUM_THREADS")
    return found if threads is None else found | {"OPENBLAS_NUM_THREADS": threads[:20]}


def environment() -> dict[str, str]:
    """Return interpreter, processor, libraries and the hash of the program's mathematics, by name."""
    return dict(_known())


def _processor() -> str:
    """The model of the processor: linear algebra chooses its instructions by it."""
    try:
        lines = _CPU.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return (next(models, "") or platform.processor() or platform.machine())[:300]


def _code_hash() -> str:
    """SHA-256 of all sources of `alignment`: a version number alone does not tell a changed program."""
    content = hashlib.sha256()
    root = Path(alignment.__file__).parent
    for path in sorted(root.rglob("*.py")):
        content.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return content.hexdigest()
