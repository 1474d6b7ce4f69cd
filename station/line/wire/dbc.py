"""The line's DBC: the one description of every bit on the bus, checked once against what the program needs.

The wheels and axles of a station are those of its DBC: a further wheel is a bit ``WheelX`` in Command, the
messages ``WheelResultX``, ``WheelUncertaintyX``, ``WheelAxisX``, ``LiveAnglesX`` and ``LiveAgeX`` and a word
in ``ErrorDetail.Wheel``, a further axle ``AxleResultX`` and ``AxleUncertaintyX``. Where a wheel is guided
there are ``GuidanceX``, ``GuidanceTargetX`` and ``WheelRawX`` too, where it is steered all of ``Sweep…X``; an
axle with ride heights has ``RideHeightX`` and ``RideHeightUsedX``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import can
from cantools.database.can import Database, Message
from cantools.database.can.signal import Signal
from cantools.errors import Error as CantoolsError

from alignment.errors import ConfigurationError, InputError
from station.cycle import AXIS_DIFFERENCES, AXIS_QUANTITIES
from station.line.wire import master_needs, steering_needs
from station.line.wire.dbc_needs import (
    FIXED,
    FLAG,
    GEOMETRY_MESSAGES,
    INTERFACE_MAJOR,
    INVALID,
    PER_AXLE,
    PER_WHEEL,
    VIN,
    Need,
    Needs,
    needed_since_2,
)
from station.line.wire.dbc_text import DAMAGED, read_dbc
from station.line.wire.protection import E2eParameters
from station.line.wire.reserved import reserved_for

Value = float | int | str
_FLAG_WORDS = {"no": 0, "yes": 1}
VIN_LENGTH = 17


# Where AUTOSAR E2E profile 1, variant 1A has its signals: CRC in byte 0, counter in the low half of byte 1.
_E2E_SIGNALS = {"E2eCrc": (0, 8), "E2eCounter": (8, 4)}
_E2E_PROFILE = "P01A"
_SHORTEST_MS = 10


def snake_case(name: str) -> str:
    """``FrontLeft`` of the DBC as ``front_left`` of the program."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


class LineDatabase:
    """A DBC that holds everything the line interface uses; encodes and decodes its messages.

    Parameters
    ----------
    database, file
        What was read, and where.
    older
        Whether it may be of an older interface, which is enough to read what was recorded by it.

    Attributes
    ----------
    file
        Where it came from.
    wheels, axles, guided, steered, levelled
        Program's name (``front_left``) to the ending of the DBC's names (``FrontLeft``), in the order of the
        bits of Command and of the identifiers. Of the wheels, those with guidance and those that are steered;
        of the axles, those with ride heights.
    vin_messages
        The messages that carry the VIN to the signals of its characters, in order.
    geometry, steering_axes
        Quantities of the vehicle's geometry and steering axes to their messages, in the order of sending.
    has_steering
        Whether the DBC has what 3.1 added, from the steering wheel to guidance.
    has_master
        Whether the DBC has what 3.2 added, the station's master checks.
    protected
        End-to-end parameters of every message of the line, by its name.
    interface_version
        Major and minor.
    definition
        The whole DBC, for documents.
    """

    def __init__(self, database: Database, file: Path, *, older: bool = False) -> None:
        self.file = file
        self.definition = database
        self.protected: dict[str, E2eParameters] = {}
        self._check_unique(database)
        self._by_name = {message.name: message for message in database.messages}
        self._by_id = {message.frame_id: message for message in database.messages}
        self.interface_version = self._version(database, older)
        self.geometry: Mapping[str, str] = GEOMETRY_MESSAGES
        self.has_steering = self.interface_version >= steering_needs.STEERING_SINCE
        self.has_master = self.interface_version >= master_needs.MASTER_SINCE
        fixed, per_wheel = self._needs(FIXED), self._needs(PER_WHEEL)
        for name, needs in [*fixed.items(), *(master_needs.MASTER_FIXED.items() if self.has_master else ())]:
            self._check_message(name, needs)
        bits = [s for s in self._by_name["Command"].signals if re.fullmatch(r"Wheel[A-Z]\w*", s.name)]
        bits.sort(key=lambda signal: signal.start)
        self.wheels = self._parts("WheelResult", (signal.name.removeprefix("Wheel") for signal in bits))
        for ending in self.wheels.values():
            self._check_message("Command", {f"Wheel{ending}": FLAG})
            for stem, needs in per_wheel.items():
                self._check_message(stem + ending, needs)
        results = sorted((m for m in database.messages if m.name.startswith("AxleResult")), key=_frame_id)
        self.axles = self._parts("AxleResult", (m.name.removeprefix("AxleResult") for m in results))
        for ending in self.axles.values():
            for stem, needs in PER_AXLE.items():
                self._check_message(stem + ending, needs)
        self.vin_messages = {
            name: tuple(n for n in needs if n != "SequenceLow") for name, needs in VIN.items()
        }
        self.guided = self._having(steering_needs.STEERING_PER_WHEEL, self.wheels)
        self.steered = self._having(steering_needs.PER_STEERED, self.wheels)
        self.levelled = self._having(steering_needs.STEERING_PER_AXLE, self.axles)
        message = steering_needs.axis_message
        self.steering_axes: dict[str, str] = {}
        if self.has_steering:
            for name, needs in steering_needs.STEERING_FIXED.items():
                self._check_message(name, needs)
            for wheel, ending in self.steered.items():
                self.steering_axes |= {f"{wheel}.{name}": message(name, ending) for name in AXIS_QUANTITIES}
            self.steering_axes |= {name: message(name) for name in AXIS_DIFFERENCES}
        self._check_wheel_numbers()
        self._check_data_ids()
        self._check_times()

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
                seen=_kind_of(frame),
            )
        decoded = message.decode_simple(bytes(frame.data))
        return {key: _plain(value) for key, value in decoded.items()}

    def range_of(self, message: str, signal: str) -> tuple[float, float]:
        """Lowest and highest physical value a signal carries, without its reserved raw values."""
        return _physical_range(self._by_name[message].get_signal_by_name(signal))

    def step(self, message: str, signal: str) -> float:
        """Physical value of one raw step of a signal."""
        return float(self._by_name[message].get_signal_by_name(signal).scale)

    def unit(self, message: str, signal: str) -> str:
        """Unit of a signal, as the DBC writes it."""
        return str(self._by_name[message].get_signal_by_name(signal).unit)

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
        of_wheel, of_axle = ("Uncertainty", "Axis", "Result"), ("Uncertainty", "Result")
        parts = [f"Wheel{part}{e}" for e in self.wheels.values() for part in of_wheel]
        parts += [f"Axle{part}{e}" for e in self.axles.values() for part in of_axle]
        parts += ["VehicleReference", *self.geometry.values()]
        if self.has_steering:
            parts += [f"WheelRaw{e}" for e in self.guided.values()]
            parts += [f"RideHeightUsed{e}" for e in self.levelled.values()]
            parts += ["SteeringWheelResult", *self.steering_axes.values()]
        return (*parts, "VehicleResult")

    def signals(self, message: str) -> tuple[str, ...]:
        """Names of a message's signals, without those of the end-to-end protection."""
        return tuple(s.name for s in self._by_name[message].signals if s.name not in _E2E_SIGNALS)

    def messages_from(self, sender: str) -> tuple[str, ...]:
        """Names of the line's messages that a node sends."""
        return tuple(name for name in self.protected if sender in self._by_name[name].senders)

    def _version(self, database: Database, older: bool) -> tuple[int, int]:
        major = self._number(database.dbc, "the DBC", "InterfaceMajor", 0, 255, missing=0)
        if major > INTERFACE_MAJOR or (major < INTERFACE_MAJOR and not older):
            raise ConfigurationError(
                file=self.file,
                field="the DBC, attribute InterfaceMajor",
                expected=f"{INTERFACE_MAJOR}, the interface that this program speaks",
                seen=str(major) if major else "none",
                cure="Take configs/line.dbc of this program, and put into it what you had changed in yours.",
            )
        return major, self._number(database.dbc, "the DBC", "InterfaceMinor", 0, 255, missing=0)

    def _needs(self, needs: Needs) -> Needs:
        if not self.has_master:
            needs = master_needs.without_master(needs)
        if not self.has_steering:
            needs = steering_needs.without_steering(needs)
        return needs if self.interface_version[0] == INTERFACE_MAJOR else needed_since_2(needs)

    def _having(self, needs: Needs, parts: Mapping[str, str]) -> dict[str, str]:
        """Wheels or axles that the DBC has any of these messages of; then it has all, as they must be."""
        having = {}
        for part, ending in parts.items():
            if self.has_steering and any(stem + ending in self._by_name for stem in needs):
                having[part] = ending
                for stem in needs:
                    self._check_message(stem + ending, needs[stem])
        return having

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
        if (taken := reserved_for(message.frame_id)) is not None:
            raise ConfigurationError(
                file=self.file,
                field=name,
                expected="an identifier that is not reserved",
                seen=f"0x{message.frame_id:X}, reserved for {taken}",
            )
        self.protected[name] = self._protection(message)
        for signal, need in needs.items():
            self._check_signal(message, signal, need)

    def _protection(self, message: Message) -> E2eParameters:
        for name, place in _E2E_SIGNALS.items():
            signal = next((s for s in message.signals if s.name == name), None)
            fits = signal is not None and (signal.start, signal.length) == place and not signal.is_signed
            if signal is None or not fits or signal.byte_order != "little_endian" or signal.is_float:
                raise ConfigurationError(
                    file=self.file,
                    field=f"{message.name}.{name}",
                    expected=f"{place[1]} unsigned bits from bit {place[0]}, for the end-to-end protection",
                    seen="none" if signal is None else f"{signal.length} bits from bit {signal.start}",
                )
        profile = message.dbc.attributes.get("E2EProfile") if message.dbc else None
        word = "none" if profile is None else profile.value
        words = list(profile.definition.choices or []) if profile is not None else []
        if isinstance(word, int) and 0 <= word < len(words):
            word = words[word]
        if word != _E2E_PROFILE:
            raise ConfigurationError(
                file=self.file,
                field=f"{message.name}, attribute E2EProfile",
                expected=_E2E_PROFILE,
                seen=str(word),
            )
        return E2eParameters(
            self._number(message.dbc, message.name, "E2EDataId", 0, 65535),
            self._number(message.dbc, message.name, "E2EMaxDeltaCounter", 1, 14, missing=1),
        )

    def _number(
        self, holder: Any, name: str, attribute: str, lowest: int, highest: int, missing: int | None = None
    ) -> int:
        """Value of an attribute that must be a whole number in a range; `missing` where it is not set."""
        value = _attribute(holder, attribute)
        if value is None and missing is not None:
            return missing
        if not isinstance(value, int | float) or value != int(value) or not lowest <= value <= highest:
            raise ConfigurationError(
                file=self.file,
                field=f"{name}, attribute {attribute}",
                expected=f"a whole number from {lowest} to {highest}",
                seen="none" if value is None else repr(value),
            )
        return int(value)

    def _check_unique(self, database: Database) -> None:
        """No two messages of one name or identifier, of which one would hide the other."""
        seen: set[str | int] = set()
        for message in database.messages:
            for key in (message.name, message.frame_id):
                if key in seen:
                    raise ConfigurationError(
                        file=self.file,
                        field=message.name,
                        expected="a name and an identifier that no other message has",
                        seen=f"0x{message.frame_id:X} twice" if key == message.frame_id else "it twice",
                    )
                seen.add(key)

    def _check_times(self) -> None:
        """Cycle times and timeouts are none (0) or of an order that a line can keep."""
        for name in self.protected:
            for attribute in ("GenMsgCycleTime", "GenMsgCycleTimeFast", "GenMsgTimeoutTime"):
                milliseconds = self._number(self._by_name[name].dbc, name, attribute, 0, 65535, missing=0)
                if 0 < milliseconds < _SHORTEST_MS:
                    raise ConfigurationError(
                        file=self.file,
                        field=f"{name}, attribute {attribute}",
                        expected=f"0, or {_SHORTEST_MS} to 65535 milliseconds",
                        seen=str(milliseconds),
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
        if signal.is_float or not (math.isfinite(signal.scale) and math.isfinite(signal.offset)):
            raise wrong("a whole raw value, a finite scale and offset", f"{signal.scale}, {signal.offset}")
        if signal.scale <= 0:
            raise wrong("a scale above 0", f"{signal.scale:g}")
        table = {str(word) for word in (signal.choices or {}).values()}
        # A value that is a word for the library is no number any more, and a flag's 0 would be taken for yes.
        if not need.words and (extra := table - (set(_FLAG_WORDS) if need is FLAG else set())):
            raise wrong("numbers, without a value table", ", ".join(sorted(extra)))
        numbers = {str(word): number for number, word in (signal.choices or {}).items()}
        if need is FLAG and numbers and numbers != _FLAG_WORDS:
            raise wrong("the words 0 no, 1 yes", ", ".join(f"{n} {word}" for word, n in numbers.items()))
        if missing := [word for word in need.words if word not in table]:
            raise wrong(
                f"the words {', '.join(missing)} in the value table", ", ".join(sorted(table)) or "none"
            )
        raw_lowest, raw_highest = _raw_range(signal)
        for number, word in (signal.choices or {}).items():
            if str(word) in need.words and not raw_lowest <= number <= raw_highest:
                raise wrong(f"a number of {signal.length} bits for the word {word}", str(number))
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


def load_line_database(path: str | PathLike[str], *, older: bool = False) -> LineDatabase:
    """Read a DBC and check that it describes the whole line interface, or an older one where that is enough.

    Raises
    ------
    ConfigurationError
        Naming the file, and the line of a syntax error or the message or signal that is missing or too small.
    """
    file = Path(path)
    database = read_dbc(file)
    try:
        return LineDatabase(database, file, older=older)
    except ConfigurationError:
        raise
    except DAMAGED as error:
        raise ConfigurationError(file=file, expected="a DBC of the line", seen=repr(error)) from error


def _kind_of(frame: can.Message) -> str:
    """What a frame is that is not what it should be."""
    if frame.is_remote_frame:
        return "a remote request"
    return f"{'a CAN FD frame of ' if frame.is_fd else ''}{len(frame.data)} bytes"


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


def _raw_range(signal: Signal) -> tuple[int, int]:
    """What a signal's bits can hold."""
    lowest = -(2 ** (signal.length - 1)) if signal.is_signed else 0
    return lowest, 2 ** (signal.length - signal.is_signed) - 1


def _physical_range(signal: Signal) -> tuple[float, float]:
    """What a signal can carry: what its bits can hold, within the limits the DBC sets."""
    lowest, highest = (raw * signal.scale + signal.offset for raw in _raw_range(signal))
    if signal.minimum is not None:
        lowest = max(lowest, signal.minimum)
    if signal.maximum is not None:
        highest = min(highest, signal.maximum)
    return lowest, highest
