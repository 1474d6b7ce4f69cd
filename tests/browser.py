"""Chromium without a window, where it is installed: what a page measures when somebody opens it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
_TIME_LIMIT_S = 120
_ASK = """<script>addEventListener('load', () => setTimeout(() => {
  const root = document.documentElement, answer = %s;
  document.body.textContent = '@@' + JSON.stringify(answer) + '@@';
}, 800))</script></body>"""


def chromium() -> str:
    """The program; the test is skipped where it is missing."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip("chromium is not installed: apt-get install chromium")
    return found


def asked(page: Path, folder: Path, width: int, question: str) -> Any:
    """Answer of an expression of JavaScript in a window of a width, pixels."""
    with_question = folder / "asked.html"
    with_question.write_text(
        page.read_text(encoding="utf-8").replace("</body>", _ASK % question), encoding="utf-8"
    )
    size = f"--window-size={width},1200"
    dump = _run(folder, size, "--virtual-time-budget=8000", "--dump-dom", with_question.as_uri())
    return json.loads(re.findall(r"<body[^>]*>@@(.*?)@@", dump)[-1])


def printed(page: Path, path: Path) -> None:
    """Print a page as a PDF."""
    _run(path.parent, "--no-pdf-header-footer", "--virtual-time-budget=8000", f"--print-to-pdf={path}",
         page.as_uri())  # fmt: skip


def _run(folder: Path, *arguments: str) -> str:
    usual = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars")
    command = [chromium(), *usual, f"--user-data-dir={folder / 'profile'}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_TIME_LIMIT_S, check=True)
    return done.stdout
