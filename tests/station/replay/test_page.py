"""The page about measuring archived images again: its commands, in order, on an archive of three wheels."""

from __future__ import annotations

import json
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from alignment.geometry.transforms import RigidTransform
from station.cli import main
from tests.documents import snippets
from tests.station.replay.test_one import document, station
from tests.station.replay.test_run import cluster, wait_for

PAGE = "docs/how-to/measure-again.md"
STATUS = {"--vin": 0, "--calibration": 1, "--scheduler": 0}
"""What each command of the page ends with here: the corrected calibration gives other angles."""


def ended(words: list[str]) -> int:
    with pytest.raises(SystemExit) as end:
        main(words)
    return int(end.value.code or 0)


@pytest.mark.slow(16)
def test_the_commands_of_the_page_do_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(station(), tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    turn = RigidTransform.from_rotvec(np.array([0.0, 0.001, 0.0]), np.zeros(3))
    Path("corrected.json").write_text(json.dumps(document(tmp_path, turn)), encoding="utf-8")
    shown = [shlex.split(line) for text in snippets(PAGE, "sh") for line in text.splitlines()]
    replays = [words[2:] for words in shown if words[:2] == [".venv/bin/truewheel", "replay"]]
    started = [words for words in shown if words[0] == "dask"]
    assert len(replays) + len(started) == len(shown)
    # What the page starts is started here on a port that is free, by the same options.
    assert [words[1] for words in started] == ["scheduler", "worker"]
    assert all("--no-dashboard" in words and "127.0.0.1" in words for words in started)
    seen = set()
    for words in replays:
        (kind,) = {option for option in STATUS if option in words}
        seen.add(kind)
        if kind == "--scheduler":
            pytest.importorskip("distributed", reason="truewheel[cluster] is not installed")
            with cluster() as address:
                wait_for(address, 2)
                given = [address if word.startswith("tcp://") else word for word in words]
                assert ended(["replay", *given]) == STATUS[kind], capsys.readouterr()
            lines = Path("replay.jsonl").read_text(encoding="utf-8").splitlines()
            assert len(lines) == 1 + 3
            continue
        assert ended(["replay", *words]) == STATUS[kind], capsys.readouterr()
        said = capsys.readouterr().out
        assert ("other calibration" in said) == (kind == "--calibration")
    assert seen == set(STATUS)
