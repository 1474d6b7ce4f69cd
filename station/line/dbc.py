"""The line's DBC: the one description of every bit on the bus, checked once against what the program needs.

The wheels and axles of a station are those of its DBC: a further wheel is a bit ``WheelX`` in Command, the
messages ``WheelResultX``, ``WheelUncertaintyX`` and ``LiveAnglesX`` and a word in ``ErrorDetail.Wheel``, a
further axle ``AxleResultX`` and ``AxleUncertaintyX``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import can
from cantools.database.can import Database, Message
from cantools.database.can.signal import Signal
from cantools.errors import Error as CantoolsError
from textparser import ParseError

from alignment.errors import ConfigurationError, FormatError, InputError
from alignment.file_limits import TEXT
from sensors.formats.files import read_bytes
from station.line.messages import (
    Answer,
    CommandCode,
    HandshakeState,
    LineErrorCode,
    LiveState,
    Mode,
    Outcome,
    Part,
    Quality,
    StationState,
)
from station.line.protection import E2eParameters

Value = float | int | str
INVALID = "invalid"
_FLAG_WORDS = {"no": 0, "yes": 1}
VIN_LENGTH = 17


@dataclass(frozen=True)
class Need:
    """What one signal must at least offer: a physical range, a resolution, the words of its value table."""

    lowest: float = 0.0
    highest: float = 1.0
    step: float = 1.0
    words: tuple[str, ...] = ()


_SEQUENCE = Need(highest=255)
_FLAG = Need()
_OUTCOME = Need(words=("none", *Outcome))
_ANGLE = Need(lowest=-10.0, highest=10.0, step=1e-4, words=(INVALID,))
_SUM = Need(lowest=-20.0, highest=20.0, step=1e-4, words=(INVALID,))
_UNCERTAINTY = Need(highest=1.0, step=1e-4, words=(INVALID,))

_VIN = {
    "Vin1": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(1, 7)}},
    "Vin2": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(7, 13)}},
    "Vin3": {"SequenceLow": Need(highest=15), **{f"Vin{k:02d}": Need(highest=127) for k in range(13, 18)}},
}
_FIXED = {
    **_VIN,
    "Command": {
        "Code": Need(words=tuple(CommandCode)),
        "Sequence": _SEQUENCE,
        "Mode": Need(words=tuple(Mode)),
        "VehicleType": Need(highest=65535),
        "Heartbeat": _SEQUENCE,
    },
    "Status": {
        "State": Need(words=tuple(StationState)),
        "Sequence": _SEQUENCE,
        "Ready": _FLAG,
        "Busy": _FLAG,
        "ResultValid": _FLAG,
        "Fault": _FLAG,
        "Handshake": Need(words=tuple(HandshakeState)),
        "AliveCounter": Need(highest=255),
        "ErrorCode": Need(words=tuple(LineErrorCode)),
        "ErrorSequence": _SEQUENCE,
    },
    "CommandAnswer": {
        "Code": Need(words=tuple(CommandCode)),
        "Sequence": _SEQUENCE,
        "Answer": Need(words=tuple(Answer)),
        "LinkUp": _FLAG,
        "ErrorCode": Need(words=tuple(LineErrorCode)),
        "HeartbeatEcho": _SEQUENCE,
    },
    "StationInfo": dict.fromkeys(
        ("InterfaceMajor", "InterfaceMinor", "SoftwareMajor", "SoftwareMinor", "SoftwarePatch", "Boot"),
        _SEQUENCE,
    ),
    "ErrorDetail": {
        "Part": Need(words=tuple(Part)),
        "ErrorCode": Need(words=tuple(LineErrorCode)),
        "Sequence": _SEQUENCE,
        "Wheel": Need(words=("none",)),
        "Count": Need(highest=65535),
    },
    "VehicleResult": {
        "Outcome": _OUTCOME,
        "Sequence": _SEQUENCE,
        "ThrustAngle": _ANGLE,
        "ThrustSign": Need(words=("left_positive", "right_positive")),
        "ThrustAngleU95": _UNCERTAINTY,
    },
}
_PER_WHEEL = {
    "WheelUncertainty": {
        "Quality": Need(words=tuple(Quality)),
        "Sequence": _SEQUENCE,
        "CamberU95": _UNCERTAINTY,
        "ToeU95": _UNCERTAINTY,
        "Residual": Need(highest=1.0, step=0.01, words=(INVALID,)),
    },
    "WheelResult": {"Outcome": _OUTCOME, "Sequence": _SEQUENCE, "Camber": _ANGLE, "Toe": _ANGLE},
    "LiveAngles": {
        "State": Need(words=tuple(LiveState)),
        "Shot": _SEQUENCE,
        "Camber": _ANGLE,
        "Toe": _ANGLE,
    },
}
_PER_AXLE = {
    "AxleUncertainty": {
        "Sequence": _SEQUENCE,
        "TotalToeU95": _UNCERTAINTY,
        "CamberDifferenceU95": _UNCERTAINTY,
    },
    "AxleResult": {"Outcome": _OUTCOME, "Sequence": _SEQUENCE, "TotalToe": _SUM, "CamberDifference": _SUM},
}


# Where AUTOSAR E2E profile 1, variant 1A has its signals: CRC in byte 0, counter in the low half of byte 1.
_E2E_SIGNALS = {"E2eCrc": (0, 8), "E2eCounter": (8, 4)}
_E2E_PROFILE = "P01A"


def snake_case(name: str) -> str:
    """``FrontLeft`` of the DBC as ``front_left`` of the program."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class LineDatabase:
    """A DBC that holds everything the line interface uses; encodes and decodes its messages.

    Attributes
    ----------
    file
        Where it came from.
    wheels, axles
        Program's name (``front_left``) to the ending of the DBC's names (``FrontLeft``), in the order of the
        bits of Command and of the identifiers.
    vin_messages
        The messages that carry the VIN to the signals of its characters, in order.
    protected
        End-to-end parameters of every message of the line, by its name.
    interface_version
        Major and minor.
    definition
        The whole DBC, for documents.
    """

    def __init__(self, database: Database, file: Path) -> None:
        self.file = file
        self.definition = database
        self.protected: dict[str, E2eParameters] = {}
        self._by_name = {message.name: message for message in database.messages}
        self._by_id = {message.frame_id: message for message in database.messages}
        for name, needs in _FIXED.items():
            self._check_message(name, needs)
        bits = [s for s in self._by_name["Command"].signals if re.fullmatch(r"Wheel[A-Z]\w*", s.name)]
        bits.sort(key=lambda signal: signal.start)
        self.wheels = self._parts("WheelResult", (signal.name.removeprefix("Wheel") for signal in bits))
        for ending in self.wheels.values():
            self._check_message("Command", {f"Wheel{ending}": _FLAG})
            for stem, needs in _PER_WHEEL.items():
                self._check_message(stem + ending, needs)
        results = sorted((m for m in database.messages if m.name.startswith("AxleResult")), key=_frame_id)
        self.axles = self._parts("AxleResult", (m.name.removeprefix("AxleResult") for m in results))
        for ending in self.axles.values():
            for stem, needs in _PER_AXLE.items():
                self._check_message(stem + ending, needs)
        self.vin_messages = {
            name: tuple(n for n in needs if n != "SequenceLow") for name, needs in _VIN.items()
        }
        self._check_wheel_numbers()
        self._check_data_ids()
        version = (_attribute(database.dbc, f"Interface{part}") for part in ("Major", "Minor"))
        major, minor = (value if isinstance(value, int) else 0 for value in version)
        self.interface_version = major, minor

    def encode(self, name: str, values: Mapping[str, Value]) -> can.Message:
        """Make a frame of a message from the physical values or words of its signals, not yet protected.

        Raises
        ------
        InputError
            When a value is not a number, is out of the range of its signal, or is no word of its table.
        """
        message = self._by_name[name]
        try:
            data = message.encode({**dict.fromkeys(_E2E_SIGNALS, 0), **values})
        except (CantoolsError, ValueError, KeyError, OverflowError) as error:
            raise InputError(
                file=self.file,
                field=name,
                expected="values within the signals' ranges and value tables",
                seen=str(error) or repr(error),
            ) from error
        return can.Message(
            arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame, data=data
        )

    def name_of(self, frame: can.Message) -> str | None:
        """Name of the message a frame carries; None when the DBC has no such identifier."""
        message = self._by_id.get(frame.arbitration_id)
        if message is None or message.is_extended_frame != frame.is_extended_id:
            return None
        return message.name

    def decode(self, frame: can.Message) -> dict[str, Value]:
        """Physical values and words of all signals of a frame; a flag is 0 or 1.

        Raises
        ------
        InputError
            When the identifier is unknown, the frame is not an ordinary data frame, or has a wrong length.
        """
        name = self.name_of(frame)
        if name is None or frame.is_error_frame:
            raise InputError(
                file=self.file, expected="an identifier of the line", seen=f"0x{frame.arbitration_id:X}"
            )
        message = self._by_name[name]
        if frame.is_remote_frame or frame.is_fd or len(frame.data) != message.length:
            raise InputError(
                file=self.file,
                field=name,
                expected=f"a classic data frame of {message.length} bytes",
                seen=f"{len(frame.data)} bytes" + (", remote" if frame.is_remote_frame else ""),
            )
        decoded = message.decode_simple(bytes(frame.data))
        return {key: _plain(value) for key, value in decoded.items()}

    def range_of(self, message: str, signal: str) -> tuple[float, float]:
        """Lowest and highest physical value a signal carries, without its reserved raw values."""
        return _physical_range(self._by_name[message].get_signal_by_name(signal))

    def step(self, message: str, signal: str) -> float:
        """Physical value of one raw step of a signal."""
        return float(self._by_name[message].get_signal_by_name(signal).scale)

    def cycle_time_s(self, message: str) -> float | None:
        """Seconds between two frames of a cyclic message; None when it is not cyclic."""
        milliseconds = self._by_name[message].cycle_time
        return milliseconds / 1000.0 if milliseconds else None

    def timeout_s(self, message: str) -> float | None:
        """Seconds without a good frame after which a message counts as lost; None when it has no timeout."""
        milliseconds = _attribute(self._by_name[message].dbc, "GenMsgTimeoutTime")
        return float(milliseconds) / 1000.0 if milliseconds else None

    @property
    def result_messages(self) -> tuple[str, ...]:
        """Names of all messages that carry results, in the order of sending."""
        parts = [f"Wheel{part}{e}" for e in self.wheels.values() for part in ("Uncertainty", "Result")]
        parts += [f"Axle{part}{e}" for e in self.axles.values() for part in ("Uncertainty", "Result")]
        return (*parts, "VehicleResult")

    def signals(self, message: str) -> tuple[str, ...]:
        """Names of a message's signals, without those of the end-to-end protection."""
        return tuple(s.name for s in self._by_name[message].signals if s.name not in _E2E_SIGNALS)

    def messages_from(self, sender: str) -> tuple[str, ...]:
        """Names of the line's messages that a node sends."""
        return tuple(name for name in self.protected if sender in self._by_name[name].senders)

    def _parts(self, stem: str, endings: Iterable[str]) -> dict[str, str]:
        parts = {snake_case(ending): ending for ending in endings}
        if not parts:
            raise ConfigurationError(
                file=self.file, field=f"{stem}…", expected="at least one such message", seen="none"
            )
        return parts

    def _check_message(self, name: str, needs: Mapping[str, Need]) -> None:
        message = self._by_name.get(name)
        if message is None:
            raise ConfigurationError(
                file=self.file,
                field=name,
                expected="this message",
                seen="a DBC without it",
                cure="Add the message as in configs/line.dbc.",
            )
        if message.length > 8 or message.is_extended_frame or message.is_multiplexed():
            raise ConfigurationError(
                file=self.file,
                field=name,
                expected="a message of at most 8 bytes, with a standard identifier and without multiplexing",
                seen=f"{message.length} bytes, identifier 0x{message.frame_id:X}",
            )
        self.protected[name] = self._protection(message)
        for signal, need in needs.items():
            self._check_signal(message, signal, need)

    def _protection(self, message: Message) -> E2eParameters:
        for name, place in _E2E_SIGNALS.items():
            signal = next((s for s in message.signals if s.name == name), None)
            if signal is None or (signal.start, signal.length) != place or signal.is_signed:
                raise ConfigurationError(
                    file=self.file,
                    field=f"{message.name}.{name}",
                    expected=f"{place[1]} unsigned bits from bit {place[0]}, for the end-to-end protection",
                    seen="none" if signal is None else f"{signal.length} bits from bit {signal.start}",
                )
        profile = message.dbc.attributes.get("E2EProfile") if message.dbc else None
        words = profile.definition.choices if profile else []
        if profile is None or words[int(profile.value)] != _E2E_PROFILE:
            raise ConfigurationError(
                file=self.file,
                field=f"{message.name}, attribute E2EProfile",
                expected=_E2E_PROFILE,
                seen="none" if profile is None else str(profile.value),
            )
        return E2eParameters(
            int(_attribute(message.dbc, "E2EDataId") or 0),
            int(_attribute(message.dbc, "E2EMaxDeltaCounter") or 1),
        )

    def _check_wheel_numbers(self) -> None:
        signal = self._by_name["ErrorDetail"].get_signal_by_name("Wheel")
        words = {str(word) for word in (signal.choices or {}).values()}
        if missing := [wheel for wheel in self.wheels if wheel not in words]:
            raise ConfigurationError(
                file=self.file,
                field="ErrorDetail.Wheel",
                expected=f"the words {', '.join(missing)} in the value table",
                seen=", ".join(sorted(words)),
            )

    def _check_data_ids(self) -> None:
        owners: dict[int, str] = {}
        for name, parameters in self.protected.items():
            if parameters.data_id in owners:
                raise ConfigurationError(
                    file=self.file,
                    field=f"{name}, attribute E2EDataId",
                    expected="a number that no other message has",
                    seen=f"{parameters.data_id}, as in {owners[parameters.data_id]}",
                )
            owners[parameters.data_id] = name

    def _check_signal(self, message: Message, name: str, need: Need) -> None:
        def wrong(expected: str, seen: str) -> ConfigurationError:
            return ConfigurationError(
                file=self.file, field=f"{message.name}.{name}", expected=expected, seen=seen
            )

        signal = next((s for s in message.signals if s.name == name), None)
        if signal is None:
            raise wrong("this signal", "a message without it")
        table = {str(word) for word in (signal.choices or {}).values()}
        if missing := [word for word in need.words if word not in table]:
            raise wrong(
                f"the words {', '.join(missing)} in the value table", ", ".join(sorted(table)) or "none"
            )
        lowest, highest = _physical_range(signal)
        if signal.scale > need.step:
            raise wrong(f"steps of {need.step:g} or finer", f"{signal.scale:g}")
        if lowest > need.lowest or highest < need.highest:
            raise wrong(f"a range of {need.lowest:g} to {need.highest:g}", f"{lowest:g} to {highest:g}")
        if INVALID in need.words:
            reserved = float(signal.conversion.choice_to_number(INVALID)) * signal.scale + signal.offset
            if lowest <= reserved <= highest:
                raise wrong(
                    f"a reserved value '{INVALID}' outside the range {lowest:g} to {highest:g}",
                    f"{reserved:g}",
                )


def load_line_database(path: str | PathLike[str]) -> LineDatabase:
    """Read a DBC and check that it describes the whole line interface.

    Raises
    ------
    ConfigurationError
        Naming the file, and the line of a syntax error or the message or signal that is missing or too small.
    """
    file = Path(path)
    database = Database()
    try:
        database.add_dbc_string(read_bytes(file, "a DBC", TEXT).decode("cp1252"))
    except FormatError as error:
        raise ConfigurationError(
            file=file, expected=error.expected, seen=error.seen, cure=error.cure
        ) from error
    except (CantoolsError, ParseError, ValueError, KeyError) as error:
        raise ConfigurationError(file=file, expected="a valid DBC", seen=str(error) or repr(error)) from error
    return LineDatabase(database, file)


def _plain(value: object) -> Value:
    if isinstance(value, (int, float)):
        return value
    word = str(value)
    return _FLAG_WORDS.get(word, word)


def _attribute(holder: Any, name: str) -> Any:
    """Value of an attribute of the DBC; None where it is not set."""
    attributes = {} if holder is None else holder.attributes or {}
    return attributes[name].value if name in attributes else None


def _frame_id(message: Message) -> int:
    return message.frame_id


def _physical_range(signal: Signal) -> tuple[float, float]:
    """What a signal can carry: what its bits can hold, within the limits the DBC sets."""
    raw_lowest = -(2 ** (signal.length - 1)) if signal.is_signed else 0
    raw_highest = 2 ** (signal.length - signal.is_signed) - 1
    lowest, highest = (raw * signal.scale + signal.offset for raw in (raw_lowest, raw_highest))
    if signal.minimum is not None:
        lowest = max(lowest, signal.minimum)
    if signal.maximum is not None:
        highest = min(highest, signal.maximum)
    return lowest, highest
