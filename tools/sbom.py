"""Writes the bill of materials of a release, CycloneDX as JSON: `python -m tools.sbom`.

Every package of the commit's requirements.lock with its version, licence and what it needs, and whether a
station needs it (`required`), one of its extras does (`optional`), or only development (`excluded`). With the
wheel and a folder of downloaded packages their SHA-256 too. It is valid by the schema that the library ships,
or not written; the same release gives the same bits.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import tomllib
import uuid
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import Distribution, PackageNotFoundError
from pathlib import Path
from typing import Any

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.contrib.this.builders import this_component
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL
from packaging.requirements import Requirement
from packaging.utils import (
    InvalidSdistFilename,
    InvalidWheelFilename,
    canonicalize_name,
    parse_sdist_filename,
    parse_wheel_filename,
)

from tools.wheel import ROOT, epoch_of, git, locked

SCHEMA = SchemaVersion.V1_6
# The strongest first: what a station needs is not optional because an extra needs it too.
_SCOPES = (ComponentScope.REQUIRED, ComponentScope.OPTIONAL, ComponentScope.EXCLUDED)


@dataclass(frozen=True)
class Package:
    """A package of the lock as it is installed: its licence, and the packages it needs here."""

    name: str
    version: str
    licence: str | None
    needs: frozenset[str]
    scope: ComponentScope
    sha256: tuple[str, ...] = ()


def refusal(text: str) -> SystemExit:
    """Say what is wrong; the program ends with status 2."""
    print(f"tools.sbom: {text}", file=sys.stderr)
    return SystemExit(2)


def packages(project: Mapping[str, Any], lock: Mapping[str, str]) -> list[Package]:
    """Return the packages of the lock, each with what it needs and who needs it.

    Parameters
    ----------
    project
        The table ``[project]`` of pyproject.toml.
    lock
        Names to pinned versions.

    Raises
    ------
    SystemExit
        When a package is not installed in its pinned version, or one is needed that the lock does not hold.
    """
    pinned = {canonicalize_name(name): version for name, version in lock.items()}
    installed = {name: _installed(name, version) for name, version in pinned.items()}
    extras = dict(project.get("optional-dependencies", {}))
    development = extras.pop("dev", [])
    starts = (project["dependencies"], [one for given in extras.values() for one in given], development)
    found: dict[str, Package] = {}
    needs: dict[str, set[str]] = {name: set() for name in pinned}
    scope_of: dict[str, ComponentScope] = {}
    for scope, start in zip(_SCOPES, starts, strict=True):
        for name in _reached(start, installed, needs):
            scope_of.setdefault(name, scope)
    for name, version in sorted(pinned.items()):
        scope = scope_of.get(name, ComponentScope.EXCLUDED)
        found[name] = Package(name, version, licence_of(installed[name]), frozenset(needs[name]), scope)
    return list(found.values())


def _installed(name: str, version: str) -> Distribution:
    try:
        distribution = Distribution.from_name(name)
    except PackageNotFoundError:
        raise refusal(
            f"{name}: expected {version} of requirements.lock, found none. Run `make setup`"
        ) from None
    if distribution.version != version:
        seen = distribution.version
        raise refusal(f"{name}: expected {version} of requirements.lock, found {seen}. Run `make setup`")
    return distribution


def _reached(
    start: Iterable[str], installed: Mapping[str, Distribution], needs: dict[str, set[str]]
) -> set[str]:
    """Return everything that these requirements need here; `needs` learns who needs whom."""
    names: set[str] = set()
    done: set[tuple[str, str]] = set()
    open_: list[tuple[str | None, Requirement, str]] = [(None, Requirement(text), "") for text in start]
    while open_:
        asking, requirement, extra = open_.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(requirement.name)
        if name not in installed:
            raise refusal(
                f"requirements.lock: expected {name}, which {asking or 'truewheel'} needs, found none"
            )
        names.add(name)
        if asking is not None and asking != name:
            needs[asking].add(name)
        for wanted in ("", *requirement.extras):
            if (name, wanted) not in done:
                done.add((name, wanted))
                texts = installed[name].requires or []
                open_ += [(name, Requirement(text), wanted) for text in texts]
    return names


def licence_of(distribution: Distribution) -> str | None:
    """Return the licence as its makers state it, an expression where there is one; None without."""
    metadata = distribution.metadata
    stated = metadata.get("License-Expression") or metadata.get("License") or ""
    if stated and "\n" not in stated and len(stated) <= 100:
        return str(stated).strip() or None
    classified = [text for text in metadata.get_all("Classifier") or [] if text.startswith("License ::")]
    return " AND ".join(text.rpartition(" :: ")[2] for text in classified[:1]) or None


def hashes_of(folder: Path) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return the SHA-256 of every package file in a folder, by name and version.

    Raises
    ------
    SystemExit
        When there is no such folder, or no package in it.
    """
    if not folder.is_dir():
        raise refusal(f"{folder}: expected a folder of downloaded packages, found none")
    found: dict[tuple[str, str], list[str]] = {}
    for path in sorted(folder.iterdir()):
        try:
            parse = parse_wheel_filename if path.suffix == ".whl" else parse_sdist_filename
            name, version, *_ = parse(path.name)
        except (InvalidWheelFilename, InvalidSdistFilename):
            continue
        found.setdefault((name, str(version)), []).append(sha256(path))
    if not found:
        raise refusal(f"{folder}: expected a folder of downloaded packages, found no package in it")
    return {key: tuple(values) for key, values in found.items()}


def sha256(path: Path) -> str:
    """Return the hash of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def bill(
    project: Mapping[str, Any], found: Iterable[Package], commit: str, at: datetime, wheel: Path | None
) -> str:
    """Return the bill of materials as JSON, checked by the library's own schema.

    Raises
    ------
    SystemExit
        When it is not valid.
    """
    found = list(found)
    licences = LicenseFactory()
    whole = Component(
        name=project["name"],
        version=project["version"],
        type=ComponentType.APPLICATION,
        bom_ref="truewheel",
        description=project["description"],
        licenses=[licences.make_from_string(project["license"])],
        purl=PackageURL("generic", name=project["name"], version=project["version"]),
        hashes=[HashType(alg=HashAlgorithm.SHA_256, content=sha256(wheel))] if wheel else [],
        properties=[Property(name="truewheel:commit", value=commit)],
    )
    bom = Bom()
    bom.metadata.component, bom.metadata.timestamp = whole, at
    bom.metadata.tools.components.add(this_component())
    made = {}
    for one in found:
        url = PackageURL("pypi", name=one.name, version=one.version)
        made[one.name] = Component(
            name=one.name,
            version=one.version,
            type=ComponentType.LIBRARY,
            bom_ref=url.to_string(),
            purl=url,
            scope=one.scope,
            licenses=[licences.make_from_string(one.licence)] if one.licence else [],
            hashes=[HashType(alg=HashAlgorithm.SHA_256, content=content) for content in one.sha256],
        )
        bom.components.add(made[one.name])
    direct = {
        canonicalize_name(Requirement(text).name)
        for texts in (project["dependencies"], *project.get("optional-dependencies", {}).values())
        for text in texts
    }
    bom.register_dependency(whole, [made[name] for name in sorted(direct & set(made))])
    for one in found:
        bom.register_dependency(made[one.name], [made[name] for name in sorted(one.needs)])
    return _checked(bom)


def _checked(bom: Bom) -> str:
    """Give it a number that follows from what it says, and hold it against the schema."""
    bom.serial_number = uuid.UUID(int=0)
    text = make_outputter(bom, OutputFormat.JSON, SCHEMA).output_as_string()
    bom.serial_number = uuid.uuid5(uuid.NAMESPACE_URL, text)
    text = make_outputter(bom, OutputFormat.JSON, SCHEMA).output_as_string(indent=2)
    if (problem := JsonStrictValidator(SCHEMA).validate_str(text)) is not None:
        raise refusal(f"the bill of materials is not valid CycloneDX {SCHEMA.to_version()}: {problem}")
    return text + "\n"


def wheel_of(folder: Path, project: Mapping[str, Any], commit: str) -> Path | None:
    """Return the wheel of this commit in a folder; None where there is none, or one of another commit."""
    wheel = folder / f"{project['name']}-{project['version']}-py3-none-any.whl"
    try:
        with zipfile.ZipFile(wheel) as files:
            built = json.loads(files.read("station/built.json"))
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None
    return wheel if built == {"commit": commit} else None


def main() -> None:
    """Write it, and say what is in it."""
    parser = argparse.ArgumentParser(description="Write the bill of materials of a release, CycloneDX JSON.")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "dist", help="folder, that of the wheel too [dist]"
    )
    parser.add_argument("--packages", type=Path, help="folder of downloaded packages, for their hashes")
    asked = parser.parse_args()
    commit = git(ROOT, "rev-parse", "--verify", "HEAD").decode().strip()
    project = tomllib.loads(git(ROOT, "show", f"{commit}:pyproject.toml").decode())["project"]
    lock = locked(git(ROOT, "show", f"{commit}:requirements.lock").decode())
    known = hashes_of(asked.packages) if asked.packages else {}
    found = [replace(one, sha256=known.get((one.name, one.version), ())) for one in packages(project, lock)]
    at = datetime.fromtimestamp(epoch_of(ROOT, commit), UTC)
    wheel = wheel_of(asked.out, project, commit)
    text = bill(project, found, commit, at, wheel)
    asked.out.mkdir(parents=True, exist_ok=True)
    out = asked.out / f"{project['name']}-{project['version']}.cdx.json"
    part = out.with_name(f".{out.name}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(out)
    listed = json.loads(text)["components"]
    counts = ", ".join(
        f"{sum(one['scope'] == scope.value for one in listed)} {scope.value}" for scope in _SCOPES
    )
    hashed = sum("hashes" in one for one in listed)
    print(
        f"{out}: {len(listed)} packages ({counts}), hashes of {hashed},"
        f" wheel: {wheel or 'none of this commit'}"
    )
    if unknown := sorted(one["name"] for one in listed if "licenses" not in one):
        print(f"tools.sbom: no licence is stated by {', '.join(unknown)}", file=sys.stderr)


if __name__ == "__main__":
    main()
