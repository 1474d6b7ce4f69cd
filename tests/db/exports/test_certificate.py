"""PDF certificates: they hold what they should, in every script that the font has."""

from __future__ import annotations

import re
import zlib
from datetime import UTC, datetime
from pathlib import Path
from uuid import UUID

import pytest

from alignment.errors import InputError
from db.exports.certificate import tolerance_picture, write_vehicle_certificate
from db.exports.rows import AngleRow
from db.queries import VinHistory
from db.records import EventRecord, StoredCycle, StoredZero
from tests.db.example_records import CALIBRATION, NOON, check, zero

CREATED = datetime(2026, 11, 23, 8, 30, tzinfo=UTC)


@pytest.fixture
def history(cycles: list[StoredCycle], events: list[EventRecord]) -> VinHistory:
    same = [stored for stored in cycles if stored.record.vehicle == cycles[0].record.vehicle]
    stored_zero = StoredZero(zero(), None, NOON)
    return VinHistory(
        "WTEST000000000000", tuple(same), {CALIBRATION.id: CALIBRATION}, (check(),),
        {stored_zero.record.id: stored_zero}, (), tuple(events), (),
    )  # fmt: skip


def pages(path: Path) -> int:
    return len(re.findall(rb"/Type /Page\b", path.read_bytes()))


def test_certificate_of_a_vehicle_has_pictures_and_pages(tmp_path: Path, history: VinHistory) -> None:
    path = tmp_path / "c.pdf"
    written = write_vehicle_certificate(path, history, created=CREATED, source="sqlite:///r.db")
    data = path.read_bytes()
    assert written == history.cycles[-1].record.uuid
    assert data.startswith(b"%PDF-")
    assert data.rstrip().endswith(b"%%EOF")
    # One sheet, as it is filed.
    assert pages(path) == 1
    assert b"/Subtype /Image" in data
    assert b"Wheel alignment WTEST000000000000" in data or b"D:20261123083000" in data
    assert [file.name for file in tmp_path.iterdir()] == ["c.pdf"]


def test_the_same_record_gives_the_same_certificate(tmp_path: Path, history: VinHistory) -> None:
    for name in ("a.pdf", "b.pdf"):
        write_vehicle_certificate(tmp_path / name, history, created=CREATED)
    assert _streams(tmp_path / "a.pdf") == _streams(tmp_path / "b.pdf")


def test_an_older_cycle_can_be_asked_for_and_a_missing_one_is_named(
    tmp_path: Path, history: VinHistory
) -> None:
    first = history.cycles[0].record.uuid
    assert write_vehicle_certificate(tmp_path / "c.pdf", history, created=CREATED, cycle=first) == first
    with pytest.raises(InputError, match="'cycle'"):
        write_vehicle_certificate(tmp_path / "d.pdf", history, created=CREATED, cycle=UUID(int=77))
    empty = VinHistory("NOBODY", (), {}, (), {}, (), (), ())
    with pytest.raises(InputError, match="a cycle of 'NOBODY'"):
        write_vehicle_certificate(tmp_path / "d.pdf", empty, created=CREATED)
    assert not (tmp_path / "d.pdf").exists()


def test_refused_wheel_and_fault_are_on_the_certificate(tmp_path: Path, cycles: list[StoredCycle]) -> None:
    faulty = VinHistory("WTEST000000000099", (cycles[6],), {}, (), {}, (), (), ())
    write_vehicle_certificate(tmp_path / "c.pdf", faulty, created=CREATED)
    assert pages(tmp_path / "c.pdf") >= 1


def test_picture_shows_every_judged_angle(rows: list[AngleRow]) -> None:
    mine = [row for row in rows if row.cycle == rows[0].cycle]
    figure = tolerance_picture(mine)
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == ["front left camber", "front left toe", "front right camber", "front right toe"]


def _streams(path: Path) -> list[bytes]:
    """The contents of the pages, without the file's own identity."""
    found = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", path.read_bytes(), re.DOTALL)
    contents = []
    for stream in found:
        try:
            contents.append(zlib.decompress(stream))
        except zlib.error:
            contents.append(stream)
    return contents
