"""Writes the description of the line interface from the DBC, the handshake's table and the error codes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from cantools.database.can import Message
from cantools.database.can.signal import Signal

from station.configuration import CycleSettings, DatabaseSettings
from station.cycle import ErrorCode
from station.line.handshake import BEGINS, COMMANDS, EVENTS, Request, Rule
from station.line.interface import PREPARE_LIFETIME_S
from station.line.tools.document_code import C_CODE, PLC_PROGRAM
from station.line.tools.document_master import master_text
from station.line.tools.document_steering import steering_text
from station.line.tools.document_text import (
    FOR_PLC_PROGRAMMERS,
    GOOD_CYCLE,
    HEAD,
    HELD_AND_LOST,
    MODES_TEXT,
    SIGNAL_LEGEND,
    TOOLS,
)
from station.line.wire import (
    CONTROLLER_IDENTIFIERS,
    INTERFACE_MAJOR,
    MEANINGS,
    RESERVED_FOR_MODES,
    RESERVED_FOR_VINS,
    HandshakeState,
    LineDatabase,
    Value,
    protect,
)

_E2E = ("E2eCrc", "E2eCounter")


def interface_document(database: LineDatabase) -> str:
    """The whole document, Markdown; the same for the same DBC and program."""
    parts = [
        HEAD.format(major=database.interface_version[0], minor=database.interface_version[1]),
        _for_plc_programmers(database),
        PLC_PROGRAM,
        GOOD_CYCLE,
        _states(),
        HELD_AND_LOST.format(
            command_ms=_ms(database.timeout_s("Command")),
            status_ms=_ms(database.timeout_s("Status")),
            prepare_s=PREPARE_LIFETIME_S,
        ),
        MODES_TEXT.format(major=database.interface_version[0]),
        *([steering_text(database, _table)] if database.has_steering else []),
        *([master_text(_table)] if database.has_master else []),
        _protection(database),
        _messages(database),
        _signals(database),
        _error_codes(database),
        _reserved(),
        TOOLS,
    ]
    return "\n".join(part.strip() + "\n" for part in parts)


def _for_plc_programmers(database: LineDatabase) -> str:
    cycle = CycleSettings()
    store_s = float(DatabaseSettings.model_fields["timeout_s"].default)
    longest_s = cycle.measure_timeout_s + 6 * store_s
    return FOR_PLC_PROGRAMMERS.format(
        major=database.interface_version[0],
        longest_s=longest_s,
        longest_master_s=longest_s + 8 * store_s,
        longest_adjust_s=longest_s + cycle.adjust_timeout_s,
        status_ms=_ms(database.timeout_s("Status")),
        results=", ".join(f"`{name}`" for name in database.result_messages),
    )


def _table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    columns = list(head)
    lines = [columns, ["---"] * len(columns), *([str(cell) for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _ms(seconds: float | None) -> str:
    return "" if seconds is None else f"{1000 * seconds:g}"


def _states() -> str:
    rows = [
        [f"**{state}**", *(_cell(rules[request]) for request in Request)] for state, rules in COMMANDS.items()
    ]
    events = [
        [event, ", ".join(f"{source} → {target}" for source, target in ways.items() if source != target)]
        for event, ways in EVENTS.items()
    ]
    return f"""
## The handshake

Drawn from the table that the program uses. `Status.Handshake` shows the state. A start in the mode adjust
leads to adjusting instead of busy, one in the mode sweep to sweeping; a fault of the station leads from every
state to fault.

```mermaid
stateDiagram-v2
    [*] --> starting
{_edges()}
```

What every command does in every state: **→** leads to a state, *harmless* is accepted and changes nothing,
any other entry is the error code with which it is refused. "Same" is the number of the start in hand, or else
of the last one. A command of a controller that speaks another major version of the interface is refused with
`wrong_interface` in every state.

{_table(["state", *Request], rows)}

What happens without a command:

{_table(["event", "leads"], events)}
"""


def _cell(rule: Rule) -> str:
    if rule.refusal is not ErrorCode.NONE:
        return f"`{rule.refusal}`"
    return "*harmless*" if rule.target is None else f"→ {rule.target}"


def _edges() -> str:
    labels: dict[tuple[str, str], list[str]] = {}
    for state, rules in COMMANDS.items():
        for request, rule in rules.items():
            if rule.target is not None and rule.target is not state:
                labels.setdefault((state, rule.target), []).append(request.split(",")[0])
    for state in (HandshakeState.READY, HandshakeState.PREPARED):
        for mode, begun in BEGINS.items():
            labels.setdefault((state, begun), []).append(f"start to {mode}")
    for event, ways in EVENTS.items():
        for source, target in ways.items():
            # A fault may come in every state; ten more arrows would hide the rest.
            if source != target and len(ways) < len(HandshakeState):
                labels.setdefault((source, target), []).append(event)
    return "\n".join(
        f"    {source} --> {target}: {', '.join(dict.fromkeys(words))}"
        for (source, target), words in labels.items()
    )


def _protection(database: LineDatabase) -> str:
    rows = [[name, f"0x{e2e.data_id:04X}", e2e.max_delta] for name, e2e in sorted(database.protected.items())]
    return f"""
## End-to-end protection

Every message is protected by AUTOSAR E2E profile 1, variant 1A (PRS E2E Protocol): byte 0 is a CRC-8 over the
low byte and the high byte of the message's data id and then bytes 1 to 7; the low half of byte 1 is a counter
from 0 to 14, one more in each frame of the message, 0 after 14.

The CRC has the polynomial 0x1D of SAE J1850, most significant bit first, nothing reflected, **start value
0x00, and is not inverted at the end**. A library's ready-made CRC-8 SAE J1850 starts with 0xFF and inverts
at the end, and gives other values: the profile calls it so that both cancel. A receiver

- drops a frame whose CRC is wrong or whose counter is 15,
- compares the counter with that of the last frame with a right CRC, counting on from 14 to 0: a
  step from 1 to the message's largest one counts, the same number is a repetition and is dropped,
- takes a larger step as a jump: that frame is dropped, and the first one that follows in step; then frames
  count again,
- drops the very first frame, which there is nothing to compare with, and begins so again after the
  communication was lost.

The largest step is the message's own: a controller's task that looks at live frames every half second finds
their counters five and more ahead. What decides, `Status`, answers and results, it must look at more often.

{C_CODE}
To test yours: with the data id 0x0123 and eight bytes of zero the frame is `CC 00 00 00 00 00 00 00`, and
with the counter 1 `91 01 00 00 00 00 00 00`; both are examples of the specification. Frames of this line:

{_table(("message", "content", "counter", "frame"), _examples(database))}

| message | data id | largest step |
|---|---|---|
""" + "\n".join(f"| {name} | {data_id} | {step} |" for name, data_id, step in rows)


def _examples(database: LineDatabase) -> Iterator[tuple[str, str, int, str]]:
    """Frames to test a controller's CRC and signals by: message, content, counter, bytes."""
    vin: dict[str, Value] = {f"Vin{k:02d}": ord(character) for k, character in enumerate("WVWZZZ", 1)}
    idle: dict[str, Value] = {
        **dict.fromkeys(database.signals("Command"), 0),
        "Code": "none",
        "Mode": "automatic",
        "InterfaceMajor": INTERFACE_MAJOR,
    }
    start: dict[str, Value] = {"Code": "start", "Sequence": 5, "VehicleType": 258, "Heartbeat": 1}
    wheels: dict[str, Value] = {f"Wheel{ending}": 1 for ending in database.wheels.values()}
    result: dict[str, Value] = {"Outcome": "nok", "Sequence": 5, "Camber": -1.2345, "Toe": 0.25}
    axis: dict[str, Value] = {"Kind": "spin_axis", "Sequence": 5}
    axis |= {"RunOut": 1.234, "HighSpot": 271.5, "RunOutU95": 0.06, "RunOutState": "nok"}
    base: dict[str, Value] = {"State": "ok", "Sequence": 5, "Value": 2700.123, "U95": 0.08}
    examples: tuple[tuple[str, int, str, Mapping[str, Value]], ...] = (
        ("Command", 0, f"none, interface {INTERFACE_MAJOR}, all else 0", idle),
        ("Command", 1, "start, number 5, all wheels, type 258, heartbeat 1", {**idle, **start, **wheels}),
        ("Vin1", 14, "number 5, WVWZZZ", {"SequenceLow": 5, **vin}),
        ("WheelResultFrontLeft", 7, "nok, number 5, camber −1.2345°, toe 0.25°", result),
        (
            "WheelAxisFrontLeft",
            8,
            "spin axis, number 5, run-out nok, 1.234 ± 0.06 mm, high spot 271.5°",
            axis,
        ),
        ("GeometryWheelbaseLeft", 9, "ok, number 5, 2700.123 ± 0.08 mm", base),
    )
    for name, counter, content, values in examples:
        data = bytearray(database.encode(name, values).data)
        protect(data, database.protected[name].data_id, counter)
        yield name, content, counter, f"`{data.hex(' ').upper()}`"


def _messages(database: LineDatabase) -> str:
    rows = []
    for message in _sorted(database):
        attributes = message.dbc.attributes if message.dbc else {}
        fast = attributes.get("GenMsgCycleTimeFast")
        timeout = database.timeout_s(message.name)
        rows.append(
            [
                f"0x{message.frame_id:03X}",
                message.name,
                ", ".join(message.senders),
                message.send_type or "",
                message.cycle_time or "",
                fast.value if fast else "",
                _ms(timeout),
            ]
        )
    head = ("identifier", "message", "from", "sent", "every ms", "while active ms", "lost after ms")
    return f"## Messages\n\nStandard identifiers, eight bytes, Intel byte order.\n\n{_table(head, rows)}"


def _signals(database: LineDatabase) -> str:
    parts = [
        "## Signals",
        "",
        "Every message has the two signals of the end-to-end protection too: E2eCrc, byte 0, and E2eCounter,"
        " the low half of byte 1.",
        "",
        SIGNAL_LEGEND.strip(),
    ]
    for messages in _alike(database):
        first = messages[0]
        names = ", ".join(f"{m.name} (0x{m.frame_id:03X})" for m in messages)
        rows = [_signal_row(signal) for signal in first.signals if signal.name not in _E2E]
        parts += ["", f"### {names}", "", *_said_of(messages), ""]
        parts.append(_table(("signal", "bits", "range", "unit", "step", "values", "meaning"), rows))
    return "\n".join(parts)


def _signal_row(signal: Signal) -> list[str]:
    sign = "signed" if signal.is_signed else ""
    words = dict(signal.choices or {})
    table = ", ".join(f"{number} {word}" for number, word in words.items())
    enumeration = signal.unit == "code"
    return [
        signal.name,
        f"{signal.start}\\|{signal.length} {sign}".strip(),
        "" if enumeration else f"{signal.minimum:g} … {signal.maximum:g}",
        "" if enumeration else str(signal.unit),
        "" if enumeration else f"{signal.scale:g}",
        "see error codes" if signal.name == "ErrorCode" else table,
        str(signal.comment),
    ]


def _said_of(messages: list[Message]) -> list[str]:
    """The comment of messages that are alike; of quantities, what each of them holds and then the rest."""
    comments = [str(message.comment).partition(". Sent again ") for message in messages]
    if len({what for what, _, _ in comments}) == 1 or not _is_quantity(messages[0]):
        return [str(messages[0].comment)]
    rows = [[message.name, f"{what}."] for message, (what, _, _) in zip(messages, comments, strict=True)]
    return [_table(("message", "holds"), rows), "", f"Sent again {comments[0][2]}"]


def _is_quantity(message: Message) -> bool:
    return message.name.startswith(("Geometry", "Sweep"))


def _reserved() -> str:
    rows = [
        [
            each.mode,
            each.what,
            " to ".join(f"0x{end:X}" for end in sorted({each.identifiers[0], each.identifiers[-1]})),
            ", ".join(f"`{code}`" for code in each.codes),
        ]
        for each in RESERVED_FOR_MODES
    ]
    controller = f"0x{CONTROLLER_IDENTIFIERS[0]:X} to 0x{CONTROLLER_IDENTIFIERS[-1]:X}"
    vins = f"0x{RESERVED_FOR_VINS[0]:X} to 0x{RESERVED_FOR_VINS[-1]:X}"
    head = ("mode", "in which", "identifiers of the station", "error codes")
    return f"""
## Reserved

For modes that later minor versions bring. Their numbers stand in the value tables already, so that a
controller of today needs no other table then; no station of this version serves them, but for sweep, which
has an identifier to spare.

{_table(head, rows)}

Identifiers {controller} are reserved for what the controller says in them, the numbers 10 to 15 of
`Status.State` and 12 to 15 of `Status.Handshake` for their states, 22 to 39 and 115 to 139 of the error codes
for further ones. A start in a reserved mode is refused with `mode_not_available`. Identifiers {vins} are
reserved for what the station will answer when it is asked for the last result of a VIN.
"""


def _sorted(database: LineDatabase) -> list[Message]:
    return sorted(database.definition.messages, key=lambda message: message.frame_id)


def _alike(database: LineDatabase) -> Iterator[list[Message]]:
    """Messages of the line, those of the same layout together."""
    endings = [*database.wheels.values(), *database.axles.values()]
    stem = re.compile(f"^((?:Wheel|Axle|Live|Guidance|RideHeight)\\w*?)({'|'.join(endings)})$")
    groups: dict[str, list[Message]] = {}
    for message in _sorted(database):
        found = stem.match(message.name)
        name = found[1] if found else message.name
        if name in database.geometry.values():
            # All lengths are alike, and all angles.
            name = f"geometry in {message.get_signal_by_name('Value').unit}"
        elif name in database.steering_axes.values():
            name = f"sweep in {message.get_signal_by_name('Value').unit}"
        groups.setdefault(name, []).append(message)
    return iter(groups.values())


def _error_codes(database: LineDatabase) -> str:
    signal = next(
        s
        for m in database.definition.messages
        if m.name == "Status"
        for s in m.signals
        if s.name == "ErrorCode"
    )
    rows = [
        [number, f"`{word}`", MEANINGS[ErrorCode(str(word))].part, *_said(ErrorCode(str(word)))]
        for number, word in (signal.choices or {}).items()
        if str(word) != ErrorCode.NONE
    ]
    return (
        "## Error codes\n\nBelow 100 they are the answer to a command and leave the station as it was; from "
        f"100 on they are the station's.\n\n{_table(('number', 'code', 'part', 'cause', 'cure'), rows)}"
    )


def _said(code: ErrorCode) -> tuple[str, str]:
    return MEANINGS[code].cause, MEANINGS[code].cure
