"""A controller made of `docs/line-interface.md` and of nothing else.

Identifiers, data ids, signals, words and error codes are read from the page's tables, frames are packed,
protected and judged by its C code, and its steps are run as they stand. Nothing here imports the station.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.documents import ROOT, snippets
from tests.structured_text import translated

PAGE = "docs/line-interface.md"
TEXT = (ROOT / PAGE).read_text(encoding="utf-8")


@dataclass(frozen=True)
class Signal:
    start: int
    length: int
    is_signed: bool
    step: float
    words: dict[int, str]


@dataclass(frozen=True)
class Message:
    name: str
    identifier: int
    data_id: int
    largest_step: int
    sender: str
    signals: dict[str, Signal]


def rows(head: str) -> list[list[str]]:
    """Cells of the tables whose first columns are these."""
    found = []
    for table in re.findall(rf"^\| {re.escape(head)}.*\n\|[- |]+\n((?:\|.*\n)+)", TEXT, re.MULTILINE):
        for line in table.splitlines():
            found.append([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
    return found


def _signal(cells: list[str], error_codes: dict[int, str]) -> Signal:
    place, sign = (*cells[1].split(), "")[:2]
    start, length = place.split("\\|")
    words = {int(n): word for n, word in re.findall(r"(-?\d+) (\w+)", cells[5])}
    if cells[5] == "see error codes":
        words = {0: "none", **error_codes}
    return Signal(int(start), int(length), sign == "signed", float(cells[4] or 1), words)


def messages() -> dict[str, Message]:
    """Every message of the page."""
    protection = {name: (int(data_id, 16), int(step)) for name, data_id, step in rows("message | data id")}
    senders = {name: sender for _, name, sender, *_ in rows("identifier | message | from")}
    codes = {int(number): word.strip("`") for number, word, *_ in rows("number | code | part")}
    found = {}
    for title, section in re.findall(r"^### (.*)\n((?:.*\n)*?)(?=^#|\Z)", TEXT, re.MULTILINE):
        table = section[section.find("| signal |") :].splitlines()
        lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in table if line.startswith("|")]
        signals = {c[0].strip(): _signal([x.strip() for x in c], codes) for c in lines[2:]}
        for name, identifier in re.findall(r"(\w+) \(0x([0-9A-F]+)\)", title):
            found[name] = Message(name, int(identifier, 16), *protection[name], senders[name], signals)
    return found


def interface_of_the_page() -> int:
    [stated] = re.findall(r"`InterfaceMajor` in it is (\d+), always", TEXT)
    return int(stated)


class Receiver(ctypes.Structure):
    _fields_ = (("heard", ctypes.c_bool), ("unsure", ctypes.c_bool), ("last", ctypes.c_uint8))


class PageCode:
    """The page's C code, compiled with all warnings as errors."""

    def __init__(self, folder: Path) -> None:
        compiler = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
        if compiler is None:
            pytest.skip("no C compiler (gcc, cc, clang) to compile the page's code with")
        [source] = snippets(PAGE, "c")
        file = folder / "page.c"
        file.write_text(source, encoding="utf-8")
        flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-shared", "-fPIC"]
        library = folder / "page.so"
        command = [compiler, *flags, "-o", str(library), str(file)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        self._code = ctypes.CDLL(str(library))
        for name in ("get_signal", "put_signal"):
            getattr(self._code, name).restype = ctypes.c_int64
        self._code.e2e_counts.restype = ctypes.c_bool
        self._code.e2e_crc.restype = ctypes.c_uint8

    @staticmethod
    def _bytes(data: bytes | bytearray) -> Any:
        return (ctypes.c_uint8 * 8)(*data)

    def crc(self, data: bytes | bytearray, data_id: int) -> int:
        return int(self._code.e2e_crc(self._bytes(data), ctypes.c_uint16(data_id)))

    def protect(self, data: bytes | bytearray, data_id: int, counter: int) -> tuple[bytes, int]:
        """The frame, and the counter of the next one."""
        frame, count = self._bytes(data), ctypes.c_uint8(counter)
        self._code.e2e_protect(frame, ctypes.c_uint16(data_id), ctypes.byref(count))
        return bytes(frame), count.value

    def counts(self, receiver: Receiver, data: bytes | bytearray, message: Message) -> bool:
        frame, data_id = self._bytes(data), ctypes.c_uint16(message.data_id)
        step = ctypes.c_int(message.largest_step)
        return bool(self._code.e2e_counts(ctypes.byref(receiver), frame, data_id, step))

    def get(self, data: bytes | bytearray, signal: Signal) -> int:
        return int(self._code.get_signal(self._bytes(data), signal.start, signal.length, signal.is_signed))

    def put(self, data: bytearray, signal: Signal, raw: int) -> None:
        frame = self._bytes(data)
        self._code.put_signal(frame, signal.start, signal.length, ctypes.c_int64(raw))
        data[:] = bytes(frame)

    def decoded(self, message: Message, data: bytes | bytearray) -> dict[str, Any]:
        """Physical values and words; a flag is a bool."""
        values: dict[str, Any] = {}
        for name, signal in message.signals.items():
            raw = self.get(data, signal)
            if signal.words == {0: "no", 1: "yes"}:
                values[name] = bool(raw)
            else:
                values[name] = signal.words.get(raw, raw * signal.step if signal.step != 1 else raw)
        return values

    def encoded(self, message: Message, values: dict[str, Any]) -> bytearray:
        """A frame from physical values and words, not yet protected."""
        data = bytearray(8)
        for name, value in values.items():
            signal = message.signals[name]
            if isinstance(value, str):
                raw = next(number for number, word in signal.words.items() if word == value)
            else:
                raw = round(value / signal.step)
            self.put(data, signal, raw)
        return data


@dataclass
class Kept:
    """What a controller keeps over its restart: vehicles by number, and what KeepResults stored of them."""

    vehicles: dict[int, str] = field(default_factory=dict)
    results: list[tuple[str | None, int, str]] = field(default_factory=list)
    not_measured: list[tuple[str | None, int, str]] = field(default_factory=list)


class PagePlc:
    """The page's controller. `send` takes identifier and data of each frame; `waiting` are VINs to start.

    Parameters
    ----------
    longest_cycle_s
        The page's `LongestCycle`.
    """

    def __init__(
        self,
        code: PageCode,
        send: Callable[[int, bytes], None],
        kept: Kept,
        now: float,
        longest_cycle_s: float = 50.0,
        vehicle_type: int = 7,
    ) -> None:
        self.code, self.send, self.kept, self.now = code, send, kept, now
        self.messages = messages()
        self.by_identifier = {m.identifier: m for m in self.messages.values() if m.sender == "STATION"}
        self.waiting: list[str] = []
        self.vehicle_type = vehicle_type
        self.interface = interface_of_the_page()
        self._counters = dict.fromkeys(self.messages, 0)
        self._last: dict[str, dict[str, Any]] = {}
        self._heard_s: float | None = None
        self._receivers: dict[str, Receiver] = {}
        self._command, self._vin = ("none", 0), ""
        self._sent_s = self._vin_s = float("-inf")
        self._heartbeat = 0
        self._announced = False
        self._step_s = now
        program, function = snippets(PAGE, "iecst")
        self._program = translated(program)
        functions: dict[str, Callable[[], int]] = {}
        self.plc = SimpleNamespace(
            Step="power_up",
            Number=0,
            VehicleWaiting=False,
            ResetAsked=False,
            LongestCycle=longest_cycle_s,
            Put=self._put,
            ForgetResults=self._forget,
            ResultsComplete=self._complete,
            KeepResults=self._keep,
            NotMeasured=self._not_measured,
        )
        exec(translated(function), {"plc": self.plc, "functions": functions})
        self.plc.NextNumber = lambda: self._next(functions["NextNumber"])
        self._silent()

    def _next(self, function: Callable[[], int]) -> int:
        # The function's result has its own name, as the language wants it.
        kept = self.plc.NextNumber
        number = function()
        self.plc.NextNumber = kept
        return number

    def _silent(self) -> None:
        self._receivers = {name: Receiver() for name in self.messages}
        for name in ("Status", "CommandAnswer"):
            empty = dict.fromkeys(self.messages[name].signals, 0)
            self._last[name] = {**empty, "LinkUp": False}

    def receive(self, identifier: int, data: bytes) -> None:
        message = self.by_identifier.get(identifier)
        if message is None or len(data) != 8:
            return
        if not self.code.counts(self._receivers[message.name], data, message):
            return
        self._last[message.name] = self.code.decoded(message, data)
        if message.name == "Status":
            self._heard_s = self.now

    def scan(self, now: float) -> None:
        """One scan: the steps of the page, then what is due on the bus."""
        self.now = now
        plc = self.plc
        plc.StatusFresh = self._heard_s is not None and now - self._heard_s <= 0.5
        if self._heard_s is not None and not plc.StatusFresh:
            self._heard_s = None
            self._silent()
        plc.Status = SimpleNamespace(**self._last["Status"])
        plc.Answer = SimpleNamespace(**self._last["CommandAnswer"])
        if self.waiting and not self._announced:
            plc.VehicleWaiting = self._announced = True
        plc.InStep = now - self._step_s
        step = plc.Step
        exec(self._program, {"plc": plc})
        if plc.Step != step:
            self._step_s = now
        if now - self._sent_s > 0.0999:
            self._send_command()

    def _put(self, code: str, number: int) -> None:
        if (code, number) == self._command or (code == "none" == self._command[0]):
            return
        self._command = (code, number)
        if code == "start":
            self._vin, self._announced = self.waiting.pop(0), False
            self.kept.vehicles[number] = self._vin
        self._send_command()

    def _send_command(self) -> None:
        code, number = self._command
        starts = code == "start"
        if starts or self.now - self._vin_s > 0.9999:
            self._vin_s = self.now
            for first, name in ((1, "Vin1"), (7, "Vin2"), (13, "Vin3")):
                names = [n for n in self.messages[name].signals if n != "SequenceLow"]
                text = self._vin[first - 1 :] if starts else "\0" * 17
                values = {n: ord(c) for n, c in zip(names, text, strict=False)}
                self._send(name, {"SequenceLow": number % 16 if starts else 0, **values})
        wheels = {n: int(starts) for n in self.messages["Command"].signals if n.startswith("Wheel")}
        command = {"Code": code, "Sequence": number, "VehicleType": self.vehicle_type, "Mode": "automatic"}
        command["InterfaceMajor"] = self.interface
        self._send("Command", {**command, **wheels, "Heartbeat": self._heartbeat})
        self._heartbeat = (self._heartbeat + 1) % 256
        self._sent_s = self.now

    def _send(self, name: str, values: dict[str, Any]) -> None:
        message = self.messages[name]
        data = self.code.encoded(message, values)
        frame, self._counters[name] = self.code.protect(data, message.data_id, self._counters[name])
        self.send(message.identifier, frame)

    def _result_names(self) -> list[str]:
        return re.findall(
            r"`(\w+)`", TEXT.split("The result messages, in the order of sending:")[1].split("\n")[0]
        )

    def _forget(self) -> None:
        for name in self._result_names():
            self._last.pop(name, None)

    def _complete(self, number: int) -> bool:
        return all(self._last.get(name, {}).get("Sequence") == number for name in self._result_names())

    def _keep(self, number: int) -> None:
        outcome = self._last["VehicleResult"]["Outcome"]
        self.kept.results.append((self.kept.vehicles.get(number), number, outcome))

    def _not_measured(self, number: int, why: str) -> None:
        self.kept.not_measured.append((self.kept.vehicles.get(number), number, why))
