"""Pages that run a station, word for word: what one terminal runs stands while the next one talks to it."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import pytest

from tests.documents import ROOT, Fence, fences
from tests.end_to_end.conftest import Truewheel

PAGE = ROOT / "docs" / "how-to" / "commission-a-station.md"
# What runs until it is told to end, and the words by which it says that it does.
STANDING = {("run",): "is ready: "}
LIMIT_S = 240.0


@contextmanager
def standing(arguments: list[str], words: str) -> Iterator[str]:
    """Run a command in a process of its own; yields the line that holds the words, ends it in order after."""
    command = [sys.executable, "-m", "station.cli", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        bound = threading.Timer(LIMIT_S, process.kill)
        bound.start()
        try:
            said = []
            for line in process.stdout:
                said.append(line)
                if words in line:
                    break
            assert words in "".join(said), said
            drain = threading.Thread(target=_drain, args=(process.stdout,))
            drain.start()
            yield said[-1]
            process.terminate()
            assert process.wait(60.0) == 0
            drain.join()
        finally:
            process.kill()
            bound.cancel()
            bound.join()


def _drain(stream: IO[str]) -> None:
    while stream.read(65_536):
        pass


class Reader:
    """Does what the page says, in its order, and keeps what each command said."""

    def __init__(self, truewheel: Truewheel, stack: ExitStack) -> None:
        self._truewheel = truewheel
        self._stack = stack
        self.said: dict[str, str] = {}

    def does(self, fence: Fence) -> None:
        text = fence.text.replace("\\\n", " ")
        if fence.language == "toml":
            self._edits(text)
            return
        assert fence.language == "sh", fence.name
        for line in text.splitlines():
            program, *arguments = shlex.split(line)
            assert program in ("truewheel", ".venv/bin/truewheel")
            words = next((w for verb, w in STANDING.items() if tuple(arguments[: len(verb)]) == verb), None)
            if words is not None:
                self.said[line] = self._stack.enter_context(standing(arguments, words))
                continue
            ended = self._truewheel(*arguments)
            assert ended.status == 0, (line, ended)
            self.said[line] = ended.out

    def _edits(self, text: str) -> None:
        if "schema" in text:
            Path("configs/plates/gauge.toml").write_text(text)
            return
        path = Path("configs/station.toml")
        kept = path.read_text()
        path.write_text(kept[: kept.index("[[rigs]]")] + text)


@pytest.mark.slow(45)
def test_whoever_follows_the_page_has_a_good_vehicle_at_its_end(
    truewheel: Truewheel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with ExitStack() as stack:
        reader = Reader(truewheel, stack)
        for fence in fences(PAGE):
            reader.does(fence)
        said = {line.split(" --")[0]: out for line, out in reader.said.items()}
    assert "2 rigs, line at the other end of the cable plc" in said["truewheel run"]
    assert not Path("plc").is_symlink(), "the cable is gone with the station"
    assert "44 of 44 points passed" in said["truewheel line check"]
    assert re.search(r"^WVWZZZ1KZAW000001 ok\n  front_left   ok ", said["truewheel line plc"], re.MULTILINE)
    camber = re.search(r"front_left.camber +(\S+)", said["truewheel report vin"])
    assert camber is not None
    assert float(camber[1]) == pytest.approx(-0.5, abs=0.003)
    assert "zero-front_right" in said["truewheel report vin"]
    assert sum("accepted:" in out for out in reader.said.values()) == 2
    assert sum("within tolerance" in " ".join(out.split()) for out in reader.said.values()) == 2


@pytest.mark.slow(17)
def test_whoever_follows_the_readme_in_two_terminals_has_a_vehicle_measured(
    truewheel: Truewheel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The PLC that the README started beside the station waited for one that could never hear it."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "configs", "configs")
    shown = [fence for fence in fences(ROOT / "README.md") if fence.language == "sh"]
    [first] = [k for k, fence in enumerate(shown) if "truewheel run " in fence.text]
    with ExitStack() as stack:
        reader = Reader(truewheel, stack)
        for fence in shown[first : first + 2]:
            reader.does(fence)
    ready, plc, report = reader.said.values()
    assert "is ready: 4 rigs, line at the other end of the cable out/plc" in ready
    assert plc.startswith("WVWZZZ1KZAW000001 ok\n  front_left   ok "), plc
    assert "rear_right.toe" in report
