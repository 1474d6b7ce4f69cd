"""Packages with a camera driver, installed into a folder as pip installs them, and gone with it."""

from __future__ import annotations

from pathlib import Path

GROUP = "truewheel.cameras"


def install(
    folder: Path,
    package: str,
    drivers: dict[str, str],
    modules: dict[str, str],
    version: str = "1.0",
) -> Path:
    """Install a package: `drivers` are its entry points, `modules` its files by module name; the folder."""
    metadata = folder / f"{package.replace('-', '_')}-{version}.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.4\nName: {package}\nVersion: {version}\n")
    lines = [f"{name} = {target}" for name, target in drivers.items()]
    (metadata / "entry_points.txt").write_text("\n".join([f"[{GROUP}]", *lines]) + "\n")
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    return folder
