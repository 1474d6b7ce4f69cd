"""What this program is made of: the versions of all its parts, as a report of a fault names them.

Nothing of it opens a camera, a bus or a database, and no library is imported for its version alone.
"""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, version
from pathlib import Path
from typing import Any, get_args

from alignment.errors import InputError
from db.connection import head_revision
from sensors.drivers.installed import CAMERAS, OWN_PACKAGE, installed_drivers
from sensors.formats import SCHEMAS
from sensors.projectors import PROJECTORS
from station.configuration import SHIPPED
from station.line.wire import load_line_database
from station.warm_up import SIGNATURES

LIBRARIES = {
    "numpy": "numpy",
    "opencv": "opencv-python-headless",
    "numba": "numba",
    "scipy": "scipy",
    "sqlalchemy": "sqlalchemy",
    "python-can": "python-can",
    "cantools": "cantools",
    "pydantic": "pydantic",
    "psycopg": "psycopg",
}
"""Libraries that decide what a measurement, a record or a frame is, and the packages that bring them."""
OPTIONAL = ("pypylon", "genicam", "harvesters", "distributed")
"""Packages of the extras; a station has those that its configuration needs."""
BUILT = Path(__file__).resolve().parents[1] / "built.json"
"""Written into the wheel by the command that builds it: from which commit."""
_GIT_S = 5.0


@dataclass(frozen=True)
class ProgramSource:
    """Where the sources stand in the project's history.

    Attributes
    ----------
    commit
        Forty hexadecimal digits; None when nobody knows.
    modified
        Whether files that belong to the commit are otherwise; None when nobody knows.
    """

    commit: str | None = None
    modified: bool | None = None


@dataclass(frozen=True)
class DriverPart:
    """An installed driver of cameras or projectors, not loaded."""

    drives: str
    name: str
    package: str
    version: str


@dataclass(frozen=True)
class KernelTable:
    """The table of compiled functions: how many, for how many types of arguments, and its SHA-256."""

    functions: int
    signatures: int
    sha256: str


@dataclass(frozen=True)
class Parts:
    """Versions of everything that decides what this program does.

    Attributes
    ----------
    truewheel, source
        Its version, and its commit where it is known.
    interface
        Of the line, ``major.minor``, by the DBC that comes with the program; None when that cannot be read.
    database
        The schema revision that it reads and writes.
    formats
        Kinds of recorded files to the versions that are read, such as ``truewheel.shot/1``.
    python, platform
        As they call themselves.
    libraries, optional
        Versions by name; None for what is not installed.
    drivers
        Of cameras and projectors, from all packages.
    kernels
        The table of compiled functions.
    findings
        What could not be found out, and why.
    """

    truewheel: str
    source: ProgramSource
    interface: str | None
    database: str
    formats: Mapping[str, tuple[str, ...]]
    python: str
    platform: str
    libraries: Mapping[str, str | None]
    optional: Mapping[str, str | None]
    drivers: tuple[DriverPart, ...]
    kernels: KernelTable
    findings: tuple[str, ...] = ()


def parts_of_program(dbc: Path = SHIPPED / "line.dbc") -> Parts:
    """Find out the versions of all parts; what cannot be found out is a finding and stops nothing.

    Parameters
    ----------
    dbc
        Describes the line's interface.
    """
    interface, findings = None, []
    try:
        interface = "{}.{}".format(*load_line_database(dbc).interface_version)
    except InputError as error:
        findings.append(str(error))
    return Parts(
        truewheel=version(OWN_PACKAGE),
        source=program_source(BUILT.parents[1], BUILT),
        interface=interface,
        database=head_revision(),
        formats={
            name: tuple(get_args(model.model_fields["schema_"].annotation)) for name, model in SCHEMAS.items()
        },
        python=f"{platform.python_implementation()} {platform.python_version()}",
        platform=platform.platform(),
        libraries={name: installed_version(package) for name, package in LIBRARIES.items()},
        optional={name: installed_version(name) for name in OPTIONAL},
        drivers=tuple(
            DriverPart(drives, one.name, one.package, one.version)
            for drives, kind in (("cameras", CAMERAS), ("projectors", PROJECTORS))
            for one in installed_drivers(kind)
        ),
        kernels=kernel_table(SIGNATURES),
        findings=tuple(findings),
    )


def installed_version(package: str) -> str | None:
    """Return the version of an installed package without importing it; None when there is none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def kernel_table(signatures: Mapping[str, Mapping[str, tuple[str, ...]]]) -> KernelTable:
    """Return how large a table of compiled functions is, and a hash that changes whenever it does."""
    kernels = {(name, one) for works in signatures.values() for name, given in works.items() for one in given}
    text = json.dumps(signatures, sort_keys=True)
    return KernelTable(
        len({name for name, _ in kernels}), len(kernels), hashlib.sha256(text.encode()).hexdigest()
    )


def program_source(folder: Path, built: Path) -> ProgramSource:
    """Return the commit of the program in `folder`: what its wheel says, its checkout, or who installed it.

    Never fails: a checkout without git, or of another user, has no known commit.
    """
    try:
        return ProgramSource(_commit(json.loads(built.read_text(encoding="utf-8"))["commit"]), modified=False)
    except (OSError, ValueError, KeyError, TypeError):
        pass
    if (folder / ".git").exists():
        commit = _git(folder, "rev-parse", "--verify", "HEAD")
        changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
        return ProgramSource(commit, None if commit is None or changed is None else changed != "")
    return ProgramSource(_commit_of_installation())


def _commit(found: object) -> str:
    if not isinstance(found, str) or len(found) != 40 or set(found) - set("0123456789abcdef"):
        raise ValueError(found)
    return found


def _git(folder: Path, *command: str) -> str | None:
    """Return what git says; None when there is no git, it refuses, or it takes too long."""
    try:
        done = subprocess.run(
            ["git", "--no-optional-locks", "-C", str(folder), *command],
            capture_output=True,
            text=True,
            timeout=_GIT_S,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _commit_of_installation() -> str | None:
    """Return what pip noted when it installed from a repository (PEP 610)."""
    try:
        noted: Any = json.loads(Distribution.from_name(OWN_PACKAGE).read_text("direct_url.json") or "null")
        return _commit(noted["vcs_info"]["commit_id"])
    except (PackageNotFoundError, OSError, ValueError, KeyError, TypeError):
        return None
