"""Every verb is given every other kind of file in the place of its own: one clear error, exit 2."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from db.connection import migrate
from sensors.formats import write_calibration, write_image, write_shot
from station.cli import main
from tests.db.databases import new_database
from tests.end_to_end.conftest import CONFIGS
from tests.end_to_end.test_unfit_files import PLATES, VERBS
from tests.sensors.samples import TIME, calibration, shot

CHAIN = """\
cam0:
  camera_model: pinhole
  distortion_model: radtan
  distortion_coeffs: [0, 0, 0, 0]
  intrinsics: [400, 400, 320, 240]
  resolution: [640, 480]
"""


def written(text: str | bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(text if isinstance(text, bytes) else text.encode())


def of_shot(path: Path) -> None:
    write_shot(path.with_name("made_shot"), shot())
    shutil.copyfile(path.with_name("made_shot") / "shot.json", path)


def image(path: Path) -> None:
    write_image(path.with_name("made.png"), np.full((30, 40), 9, np.uint8))
    shutil.copyfile(path.with_name("made.png"), path)


KINDS: dict[str, Callable[[Path], object]] = {
    "calibration": lambda path: write_calibration(path, calibration(), method="test", created_utc=TIME),
    "shot": of_shot,
    "plate": lambda path: shutil.copyfile(PLATES / "rig.toml", path),
    "gauge frame": lambda path: shutil.copyfile(PLATES / "gauge.toml", path),
    "station": lambda path: shutil.copyfile(CONFIGS / "station.toml", path),
    "table": written("part,appraiser,trial,value\n1,a,1,0.5\n1,a,2,0.6\n2,a,1,0.5\n2,a,2,0.7\n"),
    "dbc": lambda path: shutil.copyfile(CONFIGS / "line.dbc", path),
    "log": written("(1764476000.000000) can0 111#0102030405060708\n"),
    "database": lambda path: migrate(f"sqlite:///{path}"),
    "image": image,
    "page": written(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n1 0 obj <<>> endobj\ntrailer <<>>\n%%EOF\n"),
    "chain": written(CHAIN),
    "nothing": written(b""),
    "bytes": written(np.random.default_rng(5).bytes(3000)),
    "zeros": written(bytes(3000)),
    "list": written("[1, 2, 3]"),
    "utf-16": written("a = 1\nb: [2]\n".encode("utf-16")),
    "words": written("Sehr geehrte Damen und Herren,\nanbei die Prüfwerte.\n".encode("cp1252")),
}
OWN = {
    "calibration of measure": {"calibration"},
    "calibration of spin": {"calibration"},
    "configuration of": {"station"},
    "shot.json": {"shot"},
    "calibration checked": {"calibration"},
    "calibration refreshed": {"calibration"},
    "calibration exported": {"calibration"},
    "zero's calibration": {"calibration"},
    "database of": {"database"},
    # A database may begin in an empty file.
    "database of migrate": {"database", "nothing"},
    "backup": {"database"},
    "gauge values": {"table"},
    "type 1": {"table"},
    "log": {"log"},
    "DBC": {"dbc"},
    # A description without a word is the standard one.
    "simulated": {"nothing"},
    "plate": {"plate"},
    "gauge frame": {"gauge frame"},
    "frame": {"gauge frame"},
    "demo": {"station"},
}


def own_kinds(name: str) -> set[str]:
    return {kind for verb, kinds in OWN.items() if name.startswith(verb) for kind in kinds}


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("kinds")
    for number, make in enumerate(KINDS.values()):
        make(folder / f"kind{number}")
    return {name: folder / f"kind{number}" for number, name in enumerate(KINDS)}


@pytest.fixture
def nothing_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing here is measured: what is wrong shows at the file."""
    monkeypatch.setattr("station.commands.warm_up.compiled_for", lambda *_: None)
    for name, module in list(sys.modules.items()):
        if name.startswith("station.commands.") and hasattr(module, "compiled_for"):
            monkeypatch.setattr(module, "compiled_for", lambda *_: None)


@pytest.mark.usefixtures("nothing_compiled")
@pytest.mark.parametrize(("name", "words"), VERBS.items(), ids=list(VERBS))
def test_another_kind_of_file_is_one_clear_error(
    kinds: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, words: str
) -> None:
    good = tmp_path / "good"
    write_shot(good, shot())
    write_calibration(good / "calibration.json", calibration(), method="test", created_utc=TIME)
    if "{database}" in words:
        new_database(tmp_path / "new.db")
    for number, kind in enumerate(kinds):
        if kind in own_kinds(name):
            continue
        place = tmp_path / f"{number}"
        place.mkdir()
        bad = place / ("bad.log" if "{bad_log}" in words else "bad")
        shutil.copyfile(kinds[kind], bad)
        for folder, file in (("bad_shot", "shot.json"), ("bad_session", "session.json")):
            (place / folder).mkdir()
            shutil.copyfile(bad, place / folder / file)
        (place / "nested").mkdir()
        (place / "nested" / "rig").symlink_to(place / "bad_session")
        if "{bad_dbc}" in words:
            shutil.copytree(CONFIGS, place / "configs")
            shutil.copyfile(bad, place / "configs" / "line.dbc")
        names = {
            "bad": bad,
            "bad_log": bad,
            "shot": good,
            "calibration": good / "calibration.json",
            "frame": PLATES / "gauge.toml",
            "out": place / "out",
            "database": f"sqlite:///{tmp_path / 'new.db'}",
            "config": CONFIGS / "station.toml",
            "bad_shot": place / "bad_shot",
            "bad_session": place / "bad_session",
            "nested": place / "nested",
            "bad_dbc": place / "configs" / "station.toml",
        }
        before = bad.read_bytes()
        with pytest.raises(SystemExit) as ended:
            main([word.format(**names) for word in words.split()])
        captured = capsys.readouterr()
        assert (ended.value.code, captured.out) == (2, ""), (kind, captured.err)
        said = [line for line in captured.err.strip().splitlines() if line]
        assert said[-1].startswith("truewheel: "), (kind, captured.err)
        assert str(place) in said[-1], (kind, captured.err)
        assert "Traceback" not in captured.err, kind
        # Nothing is made, and what was given is as it was.
        assert not (place / "out").exists(), kind
        # (An empty file is an empty database of SQLite: whoever opens it to write puts its own head there.)
        assert bad.read_bytes() == before or (name.startswith("database of") and kind == "nothing"), kind
