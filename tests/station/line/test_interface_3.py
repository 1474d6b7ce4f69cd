"""A controller of another interface is refused; kinds, run-out, geometry and ages are told and read."""

from __future__ import annotations

import itertools
import logging
import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alignment.errors import ConfigurationError, InputError, LineError
from station.cycle.words.cycle import (
    SERVED_MODES,
    Abort,
    Acknowledge,
    AxisKind,
    ErrorCode,
    LiveAngles,
    LiveState,
    Mode,
    Outcome,
    VehicleAnswer,
    WheelAnswer,
)
from station.cycle.words.geometry import (
    GEOMETRY,
    GEOMETRY_ANGLES,
    GeometryAnswer,
    QuantityAnswer,
    QuantityState,
)
from station.line.plc.results import read_results
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.messages import Answer, HandshakeState
from station.line.wire.options import DEFAULT_OPTIONS
from station.line.wire.protection import Check, Guard, protect
from station.line.wire.reserved import CONTROLLER_IDENTIFIERS, RESERVED_FOR_MODES
from station.line.wire.results import read_age, read_live, result_frames
from station.line.wire.vehicle_frames import geometry_frames, read_geometry
from tests.station.line.line_bench import DBC, Bench, dbc_of_interface_2

DATABASE = load_line_database(DBC)
TEXT = DBC.read_text(encoding="cp1252")
FOUR = tuple(DATABASE.wheels)
COMMANDS_OF_ANY = ("prepare", "start", "stop", "abort", "reset", "acknowledge")


def spin(wheel: str, **changes: object) -> WheelAnswer:
    numbers = {"run_out_mm": 1.5, "run_out_u95_mm": 0.02, "high_spot_deg": 123.4}
    run_out = {"run_out_state": QuantityState.NOK, **numbers, **changes}
    return WheelAnswer(
        wheel,
        Outcome.OK,
        -0.5,
        0.1,
        0.001,
        0.002,
        kind=AxisKind.SPIN_AXIS,
        **run_out,  # type: ignore[arg-type]
    )


def whole(**states: QuantityState) -> GeometryAnswer:
    """Every quantity with a number of its own; those of other states than measured without."""
    quantities = []
    for k, name in enumerate(GEOMETRY, 1):
        state = states.get(name.replace(".", "_"), QuantityState.UNJUDGED)
        numbers = (0.5 * k, 0.01 * k) if state.measured else (None, None)
        quantities.append(QuantityAnswer(name, state, *numbers))
    return GeometryAnswer("vehicle", "contact_centres", tuple(quantities))


@pytest.mark.parametrize("interface", [0, 1, 2, 4, 15])
@pytest.mark.parametrize("code", COMMANDS_OF_ANY)
def test_command_of_another_interface_is_refused_with_a_code_of_its_own(
    bench: Bench, code: str, interface: int
) -> None:
    """Interface 2 left these bits 0; its start was measured, and its controller read half of the results."""
    bench.vin(5)
    bench.command(code, 5, interface=interface)
    assert (bench.answer.answer, bench.answer.error_code) == (Answer.REFUSED, ErrorCode.WRONG_INTERFACE)
    assert (bench.answer.code, bench.answer.sequence) == (code, 5)
    assert bench.status.error_code is ErrorCode.WRONG_INTERFACE
    assert bench.commands() == []
    assert bench.status.ready
    bench.command("none", 5)
    bench.start(6)
    assert bench.status.busy


def test_held_results_are_not_given_to_a_controller_that_cannot_read_them(bench: Bench) -> None:
    """Left from before the station was brought to interface 3: an acknowledgement would have ended them."""
    bench.start(1)
    bench.line.send_results(1, [spin(wheel) for wheel in FOUR])
    bench.command("acknowledge", 1, interface=0)
    assert bench.status.done
    assert not [c for c in bench.commands() if isinstance(c, Acknowledge | Abort)]
    bench.command("none", 1)
    bench.command("acknowledge", 1)
    assert Acknowledge(1) in bench.commands()


def test_log_names_the_interface_of_the_controller_once(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "truewheel.line"):
        bench.clock.now += 1.0
        bench.line.tick()
        for _ in range(4):
            bench.command("none", 0, interface=0)
        for _ in range(5):
            bench.command("start", 3, interface=0)
    said = [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]
    assert len([text for text in said if "of interface 2" in text]) == 1
    [refused] = [text for text in said if "was refused" in text]
    assert "wrong_interface" in refused
    assert "VIN" not in refused, "of another interface it is not known which bits those are"


@pytest.mark.parametrize("mode", sorted(set(Mode) - SERVED_MODES))
def test_reserved_mode_is_refused_and_measures_nothing(bench: Bench, mode: str) -> None:
    bench.start(1, mode=mode)
    assert bench.answer.error_code is ErrorCode.MODE_NOT_AVAILABLE
    assert bench.commands() == []


def test_reserved_command_is_an_unknown_one_and_prepares_nothing(bench: Bench) -> None:
    """A command that the handshake has no row for would be taken for prepare."""
    bench.command("step", 4)
    assert bench.status.error_code is ErrorCode.UNKNOWN_COMMAND
    assert bench.status.handshake is HandshakeState.READY
    assert bench.commands() == []


def test_what_is_reserved_is_in_the_tables_and_nowhere_on_the_bus() -> None:
    words = {
        name: {str(word): number for number, word in (signal.choices or {}).items()}
        for name in ("Mode", "Code")
        for signal in DATABASE.definition.get_message_by_name("Command").signals
        if signal.name == name
    }
    assert [words["Mode"][mode] for mode in ("sweep", "guidance", "steering", "locate")] == [4, 5, 6, 7]
    assert words["Code"]["step"] == 7
    identifiers = [
        *CONTROLLER_IDENTIFIERS,
        *itertools.chain(*(each.identifiers for each in RESERVED_FOR_MODES)),
    ]
    assert len(set(identifiers)) == len(identifiers)
    assert not {message.frame_id for message in DATABASE.definition.messages} & set(identifiers)
    assert {each.mode for each in RESERVED_FOR_MODES} == set(Mode) - DEFAULT_OPTIONS.modes


@pytest.mark.parametrize("identifier", [0x115, 0x11F, 0x18F, 0x1A7, 0x1BF])
def test_message_at_a_reserved_identifier_is_refused(tmp_path: Path, identifier: int) -> None:
    number = DATABASE.definition.get_message_by_name("StationInfo").frame_id
    file = tmp_path / "line.dbc"
    file.write_text(re.sub(rf"\b{number}\b", str(identifier), TEXT), encoding="cp1252")
    with pytest.raises(ConfigurationError, match=f"0x{identifier:X}, reserved"):
        load_line_database(file)


def test_dbc_of_interface_2_reads_what_was_recorded_by_it_and_runs_no_station(tmp_path: Path) -> None:
    file = tmp_path / "line.dbc"
    file.write_text(dbc_of_interface_2(), encoding="cp1252")
    with pytest.raises(ConfigurationError) as caught:
        load_line_database(file)
    assert "InterfaceMajor" in str(caught.value)
    assert "configs/line.dbc" in str(caught.value)
    older = load_line_database(file, older=True)
    assert older.interface_version[0] == 2
    assert set(older.protected) < set(DATABASE.protected)
    assert len(older.protected) == 25


def test_frames_of_interface_2_are_what_they_were() -> None:
    """Bytes of the page of interface 2: recorded traffic is read by today's DBC."""
    for identifier, data, name, values in (
        (0x110, "B0 21 05 0F 02 01 01 00", "Command", {"Code": "start", "Sequence": 5, "VehicleType": 258}),
        (0x131, "30 27 05 C7 CF 4F 9C 00", "WheelResultFrontLeft", {"Camber": -1.2345, "Toe": 0.25}),
        (0x100, "18 5E 57 56 57 5A 5A 5A", "Vin1", {"SequenceLow": 5, "Vin01": ord("W")}),
    ):
        message = DATABASE.definition.get_message_by_name(name)
        assert message.frame_id == identifier
        found = message.decode(bytes.fromhex(data))
        for key, value in values.items():
            assert found[key] == (value if isinstance(value, str) else pytest.approx(value))


@pytest.mark.parametrize("name", [n for n in DATABASE.protected if n.startswith("Live")])
def test_slow_task_of_a_controller_still_counts_live_frames(name: str) -> None:
    """It sees every fifth frame: with one bound of three for all messages none of them counted."""
    guard = Guard(DATABASE.protected)
    found = []
    for counter in range(0, 60, 5):
        data = bytearray(8)
        protect(data, DATABASE.protected[name].data_id, counter % 15)
        found.append(guard.check(name, data))
    assert found == [Check.INITIAL, *[Check.SOME_LOST] * 11]
    assert {DATABASE.protected[each].max_delta for each in ("Status", "VehicleResult", "Command")} == {3}


@given(st.floats(0, 65), st.floats(0, 5), st.floats(0, 360), st.integers(0, 255))
def test_spin_axis_over_the_bus_and_back(run_out: float, u95: float, spot: float, sequence: int) -> None:
    answers = [spin(w, run_out_mm=run_out, run_out_u95_mm=u95, high_spot_deg=spot) for w in FOUR]
    _, frames = result_frames(DATABASE, sequence, FOUR, answers, (), VehicleAnswer(Outcome.NOT_REQUESTED))
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    assert tuple(results) == DATABASE.result_messages
    _, wheels, _ = read_results(DATABASE, results, sequence)
    for wheel in wheels:
        assert (wheel.kind, wheel.run_out_state) == (AxisKind.SPIN_AXIS, QuantityState.NOK)
        assert wheel.outcome is Outcome.OK
        assert wheel.run_out_mm == pytest.approx(run_out, abs=0.50001e-3)
        assert wheel.run_out_u95_mm is not None
        assert -1e-9 <= wheel.run_out_u95_mm - u95 <= 2e-2 + 1e-9
        assert wheel.high_spot_deg is not None
        assert abs((wheel.high_spot_deg - spot + 180.0) % 360.0 - 180.0) <= 0.0501


def test_tyre_plane_has_no_run_out_and_what_was_not_measured_no_kind() -> None:
    plane = WheelAnswer("front_left", Outcome.NOK, 0.0, 0.0, 0.1, 0.1, kind=AxisKind.TYRE_PLANE)
    answers = [plane, WheelAnswer("front_right", Outcome.FAULT)]
    _, frames = result_frames(DATABASE, 1, FOUR[:2], answers, (), VehicleAnswer(Outcome.NOT_REQUESTED))
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    assert results["WheelAxisFrontLeft"]["Kind"] == "tyre_plane"
    assert results["WheelAxisFrontRight"]["Kind"] == results["WheelAxisRearLeft"]["Kind"] == "none"
    assert {results[f"WheelAxis{e}"]["RunOut"] for e in DATABASE.wheels.values()} == {"invalid"}
    with pytest.raises(InputError, match="run_out_mm"):
        WheelAnswer("front_left", Outcome.OK, 0.0, 0.0, 0.1, 0.1, kind=AxisKind.TYRE_PLANE, run_out_mm=1.0)
    with pytest.raises(InputError, match="run_out_state"):
        replace(plane, run_out_state=QuantityState.NOT_MEASURED)
    with pytest.raises(InputError, match=r"front_left\.kind"):
        WheelAnswer("front_left", Outcome.FAULT, kind=AxisKind.SPIN_AXIS)
    for missing in ("run_out_mm", "run_out_u95_mm"):
        for bad in (None, float("nan"), -0.1):
            with pytest.raises(InputError, match=missing):
                spin("front_left", **{missing: bad})
    for bad in (float("nan"), -0.1, 360.1):
        with pytest.raises(InputError, match="high_spot_deg"):
            spin("front_left", high_spot_deg=bad)
    with pytest.raises(InputError, match="run_out_mm"):
        spin("front_left", run_out_state=QuantityState.NOT_MEASURED)


def test_run_out_that_noise_hides_is_told_with_what_may_hide_and_without_a_place() -> None:
    answers = [spin("front_left", run_out_mm=0.0, run_out_u95_mm=0.3, high_spot_deg=None)]
    vehicle = VehicleAnswer(Outcome.NOT_REQUESTED)
    _, frames = result_frames(DATABASE, 1, FOUR[:1], answers, (), vehicle)
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    assert results["WheelAxisFrontLeft"]["HighSpot"] == "invalid"
    _, (wheel, *_), _ = read_results(DATABASE, results, 1)
    assert (wheel.run_out_mm, wheel.high_spot_deg) == (0.0, None)
    assert wheel.run_out_u95_mm == pytest.approx(0.3)


def test_run_out_beyond_its_signal_is_refused_not_cut() -> None:
    for change in ({"run_out_mm": 65.1}, {"run_out_u95_mm": 5.1}):
        with pytest.raises(InputError, match="WheelAxisFrontLeft"):
            result_frames(
                DATABASE,
                1,
                FOUR[:1],
                [spin("front_left", **change)],
                (),
                VehicleAnswer(Outcome.NOT_REQUESTED),
            )


@given(
    st.sampled_from(GEOMETRY), st.floats(-1, 1), st.floats(0, 1), st.sampled_from(["ok", "nok", "unjudged"])
)
def test_each_quantity_over_the_bus_and_back(name: str, share: float, u_share: float, state: str) -> None:
    most, most_u, step, u_step = (
        (15.0, 1.3, 1e-4, 2e-5) if name in GEOMETRY_ANGLES else (8000.0, 65.0, 1e-3, 1e-3)
    )
    told = QuantityAnswer(name, QuantityState(state), most * share, most_u * u_share)
    frames = geometry_frames(DATABASE, 9, GeometryAnswer("stand", "sidewalls", (told,)))
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    assert all(values["Sequence"] == 9 for values in results.values())
    back = read_geometry(DATABASE, results)
    assert (back.reference, back.between) == ("stand", "sidewalls")
    [found] = back.quantities
    assert (found.name, found.state) == (name, state)
    assert found.value == pytest.approx(told.value, abs=0.50001 * step)
    assert found.u95 is not None
    assert told.u95 is not None
    assert -1e-9 <= found.u95 - told.u95 <= u_step + 1e-9


def test_whole_vehicle_over_the_bus_and_back(bench: Bench) -> None:
    told = whole(track_rear=QuantityState.NOK, yaw=QuantityState.NOT_MEASURED)
    bench.start(3)
    bench.messages()
    vehicle = VehicleAnswer(Outcome.NOK, 0.01, 0.001, geometry=told)
    assert bench.line.send_results(3, [spin(wheel) for wheel in FOUR], (), vehicle) is Outcome.NOK
    results = dict(bench.messages())
    report, _, _ = read_results(bench.database, results, 3)
    for sent, found in zip(told.quantities, report.geometry.quantities, strict=True):
        assert (found.name, found.state) == (sent.name, sent.state)
        assert found.value == (None if sent.value is None else pytest.approx(sent.value))
        assert found.u95 == (None if sent.u95 is None else pytest.approx(sent.u95))
    assert (report.geometry.reference, report.geometry.between) == ("vehicle", "contact_centres")


def test_good_vehicle_with_a_length_out_of_limits_is_not_believed() -> None:
    vehicle = VehicleAnswer(Outcome.OK, 0.01, 0.001, geometry=whole(wheelbase_left=QuantityState.NOK))
    wheels = [spin(wheel, run_out_state=QuantityState.OK) for wheel in FOUR]
    _, frames = result_frames(DATABASE, 1, FOUR, wheels, (), vehicle)
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    with pytest.raises(LineError, match="wheelbase_left"):
        read_results(DATABASE, results, 1)


def test_good_vehicle_with_a_run_out_out_of_limits_is_not_believed() -> None:
    """Such a vehicle was sent as ok, and the controller took it for one."""
    vehicle = VehicleAnswer(Outcome.OK, 0.01, 0.001, geometry=whole())
    told, frames = result_frames(DATABASE, 1, FOUR, [spin(wheel) for wheel in FOUR], (), vehicle)
    assert told is Outcome.NOK
    results = {DATABASE.name_of(frame) or "?": DATABASE.decode(frame) for frame in frames}
    assert read_results(DATABASE, results, 1)[0].outcome is Outcome.NOK
    results["VehicleResult"] |= {"Outcome": "ok"}
    with pytest.raises(LineError, match="its parts are nok"):
        read_results(DATABASE, results, 1)


@pytest.mark.parametrize(
    "change", [{"State": 9}, {"State": "not_measured"}, {"Value": "invalid"}, {"U95": "invalid"}]
)
def test_quantity_that_contradicts_itself_is_not_believed(change: dict[str, int | str]) -> None:
    results = {
        DATABASE.name_of(frame) or "?": DATABASE.decode(frame)
        for frame in geometry_frames(DATABASE, 1, whole())
    }
    results["GeometryTrackFront"] |= change
    with pytest.raises(LineError, match="contradicts itself"):
        read_geometry(DATABASE, results)


@pytest.mark.parametrize(
    "numbers", [(None, 0.1), (1.0, None), (float("nan"), 0.1), (1.0, float("inf")), (1.0, -0.1)]
)
def test_quantity_without_its_numbers_cannot_be_made(numbers: tuple[float | None, float | None]) -> None:
    with pytest.raises(InputError, match="track_front"):
        QuantityAnswer("track_front", QuantityState.OK, *numbers)
    with pytest.raises(InputError, match="no number"):
        QuantityAnswer("track_front", QuantityState.NOT_MEASURED, 1.0, 0.1)


def test_quantities_are_known_and_each_is_told_once() -> None:
    known = QuantityAnswer("yaw", QuantityState.NOT_MEASURED)
    for quantities in ((known, known), (QuantityAnswer("height", QuantityState.NOT_MEASURED),)):
        with pytest.raises(InputError, match="at most once"):
            GeometryAnswer("stand", None, quantities)


def test_length_beyond_its_signal_sends_nothing_at_all(bench: Bench) -> None:
    bench.start(1)
    bench.messages()
    far = GeometryAnswer(
        "stand", "sidewalls", (QuantityAnswer("place_x", QuantityState.UNJUDGED, 8001.0, 0.1),)
    )
    vehicle = VehicleAnswer(Outcome.OK, 0.01, 0.001, geometry=far)
    with pytest.raises(InputError, match=r"GeometryPlaceX\.Value.*mm"):
        bench.line.send_results(1, [spin(wheel) for wheel in FOUR], (), vehicle)
    assert bench.messages() == []


def live_of(bench: Bench) -> tuple[LiveAngles, float | None, AxisKind, int]:
    sent = dict(bench.messages())
    age = read_age("front_left", sent["LiveAgeFrontLeft"])
    return read_live("front_left", sent["LiveAnglesFrontLeft"]), age.age_s, age.kind, age.shot


def test_live_angles_say_how_old_they_are(bench: Bench) -> None:
    """Only fresh or stale was told: an operator turned a tie rod by angles of almost a second ago."""
    bench.start(1, mode="adjust")
    bench.messages()
    angles = LiveAngles("front_left", LiveState.INSIDE, 7, -0.5, 0.25, AxisKind.TYRE_PLANE)
    bench.line.publish_live(angles, bench.clock.now - 0.125)
    names = [name for name, _ in bench.messages()]
    assert names == ["LiveAgeFrontLeft", "LiveAnglesFrontLeft"]
    bench.clock.now += 0.3
    bench.command("none", 0)
    bench.line.tick()
    live, age_s, kind, shot = live_of(bench)
    assert (live.state, live.shot, shot, kind) == (LiveState.INSIDE, 7, 7, AxisKind.TYRE_PLANE)
    assert age_s == pytest.approx(0.425)
    bench.clock.now += 0.4
    bench.command("none", 0)
    bench.clock.now += 0.4
    bench.line.tick()
    live, age_s, kind, _ = live_of(bench)
    assert (live.state, live.camber_deg, kind) == (LiveState.STALE, None, AxisKind.NONE)
    assert age_s == pytest.approx(1.225)


def test_age_of_live_angles_that_nothing_follows_stays_at_its_largest(bench: Bench) -> None:
    bench.start(1, mode="adjust")
    bench.messages()
    bench.line.publish_live(LiveAngles("front_left", LiveState.NOT_MEASURED, 1), bench.clock.now - 3600.0)
    _, age_s, kind, _ = live_of(bench)
    assert (age_s, kind) == (65.0, AxisKind.NONE)


def test_line_has_a_message_for_every_quantity_of_a_vehicle(database: LineDatabase) -> None:
    assert tuple(database.geometry) == GEOMETRY
    assert set(database.geometry.values()) < set(database.result_messages)
    units = {name: database.unit(message, "Value") for name, message in database.geometry.items()}
    assert {name for name, unit in units.items() if unit == "deg"} == set(GEOMETRY_ANGLES)
