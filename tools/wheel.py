"""Builds the wheel of a commit, the same to the last bit wherever and whenever: `python -m tools.wheel`.

What is built is the commit and nothing else of the folder. Times in the wheel are those of the commit (or of
SOURCE_DATE_EPOCH), permissions and order do not depend on who builds, and setuptools is the one of
requirements.lock. The same Python and zlib on the builder give the same bits.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GIT_S, BUILD_S = 60.0, 300.0
_BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_wheel(sys.argv[1]))"


def git(folder: Path, *command: str) -> bytes:
    """Return what git says of a checkout; ends the program with status 2 when it cannot."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *command], capture_output=True, timeout=GIT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise refusal(f"{folder}: expected a checkout and git, found: {error}") from error
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip()
        raise refusal(f"{folder}: expected a checkout with the commit to build, found: {said}")
    return done.stdout


def refusal(text: str) -> SystemExit:
    """Say what is wrong; the program ends with status 2."""
    print(f"tools.wheel: {text}", file=sys.stderr)
    return SystemExit(2)


def locked(lock: str) -> dict[str, str]:
    """Return the pinned versions by name, from the text of requirements.lock."""
    pairs = (line.partition("==") for line in lock.split())
    return {name: pinned for name, _, pinned in pairs}


def epoch_of(checkout: Path, commit: str) -> int:
    """Return the time that stands in the wheel: SOURCE_DATE_EPOCH, or that of the commit, s since 1970."""
    given = os.environ.get("SOURCE_DATE_EPOCH", "")
    if given and not (given.isdecimal() and len(given) <= 11):
        raise refusal(f"SOURCE_DATE_EPOCH: expected whole seconds since 1970, found '{given[:40]}'")
    return int(given or git(checkout, "show", "-s", "--format=%ct", commit))


def require_builder(lock: Path) -> None:
    """Refuse another setuptools than the pinned one: it would write another wheel."""
    expected, found = locked(lock.read_text(encoding="utf-8")).get("setuptools"), version("setuptools")
    if found != expected:
        raise refusal(
            f"setuptools: expected {expected} of requirements.lock, found {found}. Run `make setup`"
        )


def extracted(checkout: Path, commit: str, target: Path) -> None:
    """Write the files of a commit into an empty folder, and beside them which commit it is."""
    with tarfile.open(fileobj=io.BytesIO(git(checkout, "archive", "--format=tar", commit))) as files:
        files.extractall(target, filter="data")
    for path in target.rglob("*"):
        executable = path.is_dir() or path.stat().st_mode & 0o100
        path.chmod(0o755 if executable else 0o644)
    note = target / "station" / "built.json"
    note.write_text(json.dumps({"commit": commit}) + "\n", encoding="utf-8")
    note.chmod(0o644)


def build(checkout: Path, out: Path, revision: str = "HEAD") -> Path:
    """Build the wheel of a commit.

    Parameters
    ----------
    checkout
        Of the project; its files that are not committed are not built.
    out
        Folder of the wheel; made when missing.
    revision
        The commit, by any name that git knows.

    Returns
    -------
    Path
        The wheel, whole or not there.
    """
    commit = git(checkout, "rev-parse", "--verify", f"{revision}^{{commit}}").decode().strip()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        source, built = Path(name) / "source", Path(name) / "built"
        source.mkdir()
        built.mkdir()
        extracted(checkout, commit, source)
        require_builder(source / "requirements.lock")
        same = {"SOURCE_DATE_EPOCH": str(epoch_of(checkout, commit)), "PYTHONHASHSEED": "0", "TZ": "UTC"}
        try:
            done = subprocess.run(
                [sys.executable, "-c", _BUILD, str(built)],
                cwd=source,
                env={**os.environ, **same, "LC_ALL": "C.UTF-8"},
                capture_output=True,
                text=True,
                timeout=BUILD_S,
                umask=0o022,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise refusal(f"the build took longer than {BUILD_S:.0f} s") from error
        if done.returncode != 0:
            raise refusal(f"setuptools built no wheel: {done.stderr.strip()[-2000:]}")
        [wheel] = built.glob("*.whl")
        # By a name of its own first: a wheel that stands there is whole.
        part = out / f".{wheel.name}.part"
        shutil.copyfile(wheel, part)
        return part.replace(out / wheel.name)


def main() -> None:
    """Build, and say what it is."""
    parser = argparse.ArgumentParser(description="Build the wheel of a commit, the same to the last bit.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheel [dist]")
    parser.add_argument("--commit", default="HEAD", help="what to build [HEAD]")
    asked = parser.parse_args()
    if asked.commit == "HEAD" and git(ROOT, "status", "--porcelain", "--untracked-files=no"):
        print("tools.wheel: files that were changed and not committed are not in the wheel", file=sys.stderr)
    wheel = build(ROOT, asked.out, asked.commit)
    print(f"{hashlib.sha256(wheel.read_bytes()).hexdigest()}  {wheel}")


if __name__ == "__main__":
    main()
