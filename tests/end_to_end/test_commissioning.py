"""docs/how-to/commission-a-station.md, word for word: from an empty folder to the first good vehicle."""

from __future__ import annotations

import re
import shlex
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
STANDING = {("line", "cable"): "/dev/pts", ("run",): "is ready: 2 rigs"}
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
            bound.cancel()
            process.kill()


def _drain(stream: IO[str]) -> None:
    while stream.read(65_536):
        pass


class Reader:
    """Does what the page says, in its order, and keeps what each command said."""

    def __init__(self, truewheel: Truewheel, stack: ExitStack) -> None:
        self._truewheel = truewheel
        self._stack = stack
        self._devices: dict[str, str] = {}
        self.said: dict[str, str] = {}

    def does(self, fence: Fence) -> None:
        text = fence.text.replace("\\\n", " ")
        if fence.language == "toml":
            self._edits(text)
            return
        assert fence.language == "sh", fence.name
        for line in text.splitlines():
            program, *arguments = shlex.split(line)
            assert program == "truewheel"
            arguments = [self._devices.get(word, word) for word in arguments]
            words = next((w for verb, w in STANDING.items() if tuple(arguments[: len(verb)]) == verb), None)
            if words is not None:
                said = self._stack.enter_context(standing(arguments, words))
                if arguments[:2] == ["line", "cable"]:
                    ends = re.findall(r"/dev/pts/\d+", said)
                    self._devices = dict(zip(("/dev/pts/3", "/dev/pts/4"), ends, strict=True))
                continue
            ended = self._truewheel(*arguments)
            assert ended.status == 0, (line, ended)
            self.said[line] = ended.out

    def _edits(self, text: str) -> None:
        if "schema" in text:
            Path("configs/plates/gauge.toml").write_text(text)
            return
        # All at once: a real device may have the name of another one of the page.
        text = re.sub(r'"(/dev/pts/\d+)"', lambda named: f'"{self._devices.get(named[1], named[1])}"', text)
        path = Path("configs/station.toml")
        kept = re.sub(r"^\[line\]\n(?:(?!\[).*\n)*", "", path.read_text(), flags=re.MULTILINE)
        path.write_text(kept[: kept.index("[[rigs]]")] + text)


@pytest.mark.slow
def test_whoever_follows_the_page_has_a_good_vehicle_at_its_end(
    truewheel: Truewheel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with ExitStack() as stack:
        reader = Reader(truewheel, stack)
        for fence in fences(PAGE):
            reader.does(fence)
        said = {line.split(" --")[0]: out for line, out in reader.said.items()}
    assert "28 of 28 points passed" in said["truewheel line check"]
    assert re.search(r"^WVWZZZ1KZAW000001 ok\n  front_left   ok ", said["truewheel line plc"], re.MULTILINE)
    camber = re.search(r"front_left.camber +(\S+)", said["truewheel report vin"])
    assert camber is not None
    assert float(camber[1]) == pytest.approx(-0.5, abs=0.003)
    assert "zero-front_right" in said["truewheel report vin"]
    assert sum("accepted:" in out for out in reader.said.values()) == 2
    assert sum("within tolerance" in " ".join(out.split()) for out in reader.said.values()) == 2
