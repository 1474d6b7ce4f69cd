"""Q-DAS ASCII transfer format (AQDEF): one file .dfq, or a description .dfd with values .dfx.

A part of the file is one vehicle type with one set of limits at one station; its characteristics are the
angles, in degrees, and lengths, in millimetres. Every value carries time (K0004), VIN (K0014) and a text
(K0009) with its uncertainty and what explains it; an event (K0005) where something happened since the value
before:

=====  =====================================================
event  meaning
=====  =====================================================
1      measured with another calibration than the value before
2      the station reported a warning or a fault
3      the same VIN was measured before
=====  =====================================================

Values of cycles that the station did not finish, and values that it did not judge, are marked invalid
(K0002 = 129): shown, and left out of the plant's calculation.

Sources: Q-DAS, ASCII Transfer Format, and the AQDEF specification, version 3: keys, lengths, date notation.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from typing import IO

from alignment.errors import ConfigurationError
from db.exports.rows import AngleRow
from db.exports.tables import replaced
from db.records import QUANTITIES, AngleVerdict, EventRecord, Quantity, Severity, Unit

ENCODINGS: Mapping[str, str] = {"utf-8": "utf-8-sig", "utf-16": "utf-16", "windows-1252": "cp1252"}
"""By the name a user gives; the Unicode ones begin with a byte order mark, by which Q-DAS knows them."""
CALIBRATION_CHANGED, STATION_EVENT, MEASURED_BEFORE = 1, 2, 3
_INVALID = 129

# Longest texts of the keys, characters.
_LENGTHS = {
    "K0009": 255, "K0014": 40, "K1001": 30, "K1002": 80, "K1011": 20, "K1014": 20, "K1081": 24, "K1082": 40,
    "K1086": 40, "K1201": 24, "K1202": 40, "K2001": 40, "K2002": 80, "K2142": 20, "K2401": 40,
    "K2402": 40,
}  # fmt: skip
_IN_MEMORY = 1 << 20


@dataclass
class _Characteristic:
    """One value of a part as the first row had it."""

    row: AngleRow
    last_calibration: str | None = None


@dataclass
class _Part:
    station: str
    vehicle_type: str
    version: int
    values: IO[str]
    characteristics: dict[str, _Characteristic] = field(default_factory=dict)
    vins: set[str] = field(default_factory=set)

    def number(self, row: AngleRow) -> int:
        self.characteristics.setdefault(row.characteristic, _Characteristic(row))
        return list(self.characteristics).index(row.characteristic) + 1


@dataclass(frozen=True)
class AqdefCounts:
    """What was written."""

    files: tuple[Path, ...]
    parts: int
    characteristics: int
    values: int


def write_aqdef(
    path: Path,
    rows: Iterable[AngleRow],
    events: Sequence[EventRecord] = (),
    *,
    encoding: str = "utf-8",
    timezone: tzinfo | None = None,
) -> AqdefCounts:
    """Write values in the order of time.

    Parameters
    ----------
    path
        ``….dfq`` for one file; ``….dfd`` or ``….dfx`` for both of them beside each other.
    rows
        In the order of time; those without a value are left out.
    events
        Of the stations in that time.
    encoding
        One of `ENCODINGS`.
    timezone
        Of the times written; UTC without. The format knows none.

    Raises
    ------
    ConfigurationError
        For another ending or encoding, or a character that the encoding does not have.
    OSError
        When a file cannot be written; those that were there stay.
    """
    ending = path.suffix.lower()
    if ending not in (".dfq", ".dfd", ".dfx"):
        raise ConfigurationError(
            choice="out", expected="a name that ends in .dfq, .dfd or .dfx", seen=path.name
        )
    if encoding not in ENCODINGS:
        raise ConfigurationError(choice="encoding", expected=f"one of {', '.join(ENCODINGS)}", seen=encoding)
    collected = _Collected(sorted(events, key=lambda event: event.utc), timezone)
    try:
        for row in rows:
            collected.add(row)
        try:
            files = _write(path, ending, ENCODINGS[encoding], collected)
        except UnicodeEncodeError as error:
            raise ConfigurationError(
                choice="encoding",
                expected=f"a character set with {error.object[error.start]!r}",
                seen=encoding,
                cure="Use utf-8",
            ) from error
    finally:
        collected.close()
    parts = collected.parts
    return AqdefCounts(files, len(parts), sum(len(part.characteristics) for part in parts), collected.values)


class _Collected:
    """Values by part; long ones wait in temporary files until the descriptions are known."""

    def __init__(self, events: Sequence[EventRecord], timezone: tzinfo | None) -> None:
        self._events = {
            station: [event for event in events if event.station == station]
            for station in {event.station for event in events}
        }
        self._next_event = dict.fromkeys(self._events, 0)
        self._timezone = timezone
        self._by_limits: dict[tuple[object, ...], _Part] = {}
        self._seen: dict[tuple[str, str], str] = {}
        self._pending: list[AngleRow] = []
        self.values = 0

    @property
    def parts(self) -> list[_Part]:
        return list(self._by_limits.values())

    def add(self, row: AngleRow) -> None:
        if self._pending and row.cycle != self._pending[0].cycle:
            self.flush()
        self._pending.append(row)

    def flush(self) -> None:
        """Write the rows of one cycle, whose limits together decide the part."""
        rows, self._pending = [row for row in self._pending if row.value is not None], []
        if not rows:
            return
        first = rows[0]
        part = self._part(first.station, first.vehicle_type, rows)
        happened = self._events_until(first.station, first.received_utc)
        before = self._seen.get((first.station, first.vin))
        self._seen[first.station, first.vin] = first.cycle
        part.vins.add(first.vin)
        for row in rows:
            self._value(part, row, happened, before)

    def close(self) -> None:
        for part in self.parts:
            part.values.close()

    def _part(self, station: str, vehicle_type: str, rows: Sequence[AngleRow]) -> _Part:
        """The part whose limits, as far as both know them, are those of the rows."""
        limits = {row.characteristic: (row.low, row.high) for row in rows}
        mine = [part for part in self.parts if (part.station, part.vehicle_type) == (station, vehicle_type)]
        for part in mine:
            known = {name: (c.row.low, c.row.high) for name, c in part.characteristics.items()}
            if all(known.get(name, pair) == pair for name, pair in limits.items()):
                return part
        spooled = tempfile.SpooledTemporaryFile(  # noqa: SIM115  (closed with all others by `close`)
            max_size=_IN_MEMORY, mode="w+", encoding="utf-8", newline="\n"
        )
        part = _Part(station, vehicle_type, len(mine) + 1, spooled)
        self._by_limits[station, vehicle_type, len(mine)] = part
        return part

    def _events_until(self, station: str, utc: datetime) -> list[EventRecord]:
        """Warnings and faults of a station since the last call."""
        all_of_it = self._events.get(station, [])
        start = end = self._next_event.get(station, 0)
        while end < len(all_of_it) and all_of_it[end].utc <= utc:
            end += 1
        self._next_event[station] = end
        return [event for event in all_of_it[start:end] if event.severity is not Severity.INFO]

    def _value(self, part: _Part, row: AngleRow, happened: Sequence[EventRecord], before: str | None) -> None:
        number = part.number(row)
        mine = part.characteristics[row.characteristic]
        changed = None not in (mine.last_calibration, row.calibration_id) and (
            mine.last_calibration != row.calibration_id
        )
        mine.last_calibration = row.calibration_id or mine.last_calibration
        codes = [CALIBRATION_CHANGED] * changed + [STATION_EVENT] * bool(happened)
        codes += [MEASURED_BEFORE] * (before is not None)
        time = row.received_utc.astimezone(self._timezone or UTC)
        self._write(part, number, "K0001", _number(row.value))
        if not row.judged_cycle or row.verdict == AngleVerdict.NOT_JUDGED:
            self._write(part, number, "K0002", str(_INVALID))
        self._write(part, number, "K0004", time.strftime("%d.%m.%Y/%H:%M:%S"))
        if codes:
            self._write(part, number, "K0005", ",".join(map(str, codes)))
        self._write(part, number, "K0009", _text(row, happened))
        if row.vin:
            self._write(part, number, "K0014", row.vin)
        self.values += 1

    def _write(self, part: _Part, number: int, key: str, text: str) -> None:
        part.values.write(f"{key}\t{number}\t{_clean(key, text)}\n")


def _write(path: Path, ending: str, encoding: str, collected: _Collected) -> tuple[Path, ...]:
    collected.flush()
    parts = collected.parts
    together = ending == ".dfq"
    files = (path,) if together else (path.with_suffix(".dfd"), path.with_suffix(".dfx"))
    with ExitStack() as opened:
        streams = [
            opened.enter_context(_open(opened.enter_context(replaced(file)), encoding)) for file in files
        ]
        descriptions, values = streams[0], streams[-1]
        _line(descriptions, "K0100", sum(len(part.characteristics) for part in parts))
        first = 0
        for number, part in enumerate(parts, start=1):
            _describe(descriptions, part, number, first)
            _copy_values(values, part, first)
            first += len(part.characteristics)
    return files


def _open(path: Path, encoding: str) -> IO[str]:
    return path.open("w", encoding=encoding, newline="\r\n")


def _describe(stream: IO[str], part: _Part, number: int, first: int) -> None:
    example = next(iter(part.characteristics.values())).row
    keys = {
        "K1001": part.vehicle_type,
        "K1002": f"Wheel alignment {part.vehicle_type}",
        "K1011": str(part.version),
        "K1081": part.station,
        "K1082": part.station,
        "K1086": "Wheel alignment",
        "K1201": "Truewheel",
        "K1202": f"Truewheel {example.software_version}",
    }
    if len(part.vins) == 1:
        keys["K1014"] = next(iter(part.vins))
    for key, text in keys.items():
        _line(stream, f"{key}/{number}", _clean(key, text))
    for local, characteristic in enumerate(part.characteristics.values(), start=1):
        row, index = characteristic.row, first + local
        unit = Unit(row.unit)
        name = f"{QUANTITIES[Quantity(row.quantity)].label} {row.part.replace('_', ' ')}"
        lines = {
            "K2001": row.characteristic,
            "K2002": name,
            "K2004": "0",
            "K2022": str(unit.decimals),
            **_limits(row),
            "K2142": unit.sign.strip(),
            "K2401": row.part,
            "K2402": f"Truewheel {part.station} {row.part}",
            "K2404": f"{10.0**-unit.decimals:.{unit.decimals}f}",
        }
        for key, text in lines.items():
            _line(stream, f"{key}/{index}", _clean(key, text))


def _limits(row: AngleRow) -> dict[str, str]:
    """Nominal value, limits, and of which kind they are: 0 none, 1 a limit."""
    keys = {}
    if row.low is not None and row.high is not None:
        keys["K2101"] = _number((row.low + row.high) / 2)
    for value, limit, kind in ((row.low, "K2110", "K2120"), (row.high, "K2111", "K2121")):
        if value is not None:
            keys[limit] = _number(value)
        keys[kind] = "0" if value is None else "1"
    return keys


def _copy_values(stream: IO[str], part: _Part, first: int) -> None:
    part.values.seek(0)
    for line in part.values:
        key, local, text = line.rstrip("\n").split("\t", 2)
        _line(stream, f"{key}/{first + int(local)}", text)


def _line(stream: IO[str], key: str, value: object) -> None:
    stream.write(f"{key} {value}\n")


def _text(row: AngleRow, happened: Sequence[EventRecord]) -> str:
    """What explains the value, the most important first: long texts are cut."""
    parts = [] if row.u is None else [f"u={row.u:.6f}"]
    parts.append(f"verdict={row.verdict}")
    if row.doubt:
        parts.append(row.doubt)
    if row.reason_code:
        parts.append(f"reason={row.reason_code}")
    if row.concession_person is not None:
        parts.append(f"released by {row.concession_person}: {row.concession_reason}")
    if row.straight_ahead in ("not_checked", "refused"):
        parts.append("straight ahead not checked")
    if row.raw_deg is not None:
        parts.append(f"raw={row.raw_deg:.6f}")
    if row.ride_height is not None:
        height = "" if row.ride_height_mm is None else f" {row.ride_height_mm:g} mm"
        parts.append(f"ride height{height} {row.ride_height.replace('_', ' ')}")
    if row.calibration_id:
        parts.append(f"calibration={row.calibration_id}")
    parts.append(f"cycle={row.cycle}")
    parts += [f"{event.code}: {event.text}" for event in happened]
    return "; ".join(parts)


def _number(value: float | None) -> str:
    """Degrees or millimetres to 1e-10, far below what is measured; at most 22 characters, no exponent."""
    text = f"{0.0 if value is None else value:.10f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _clean(key: str, text: str) -> str:
    """Text on one line, no longer than the key allows; what no line can hold becomes a blank."""
    plain = "".join(character if character.isprintable() else " " for character in text).strip()
    return plain[: _LENGTHS.get(key, 255)]
