"""Two processes on a cable, the same killed at steps of a cycle, and noise on the line: short versions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from station.cycle.words.cycle import ErrorCode, StationState
from station.line.wire.dbc import LineDatabase, load_line_database
from station.line.wire.messages import HandshakeState, LineStatus
from station.rehearsal.endurance import run_endurance
from station.rehearsal.noise import NOISE_KINDS, Noise, contradiction, run_noise
from station.rehearsal.power_loss import PowerLossBench, open_power_loss
from station.rehearsal.prepared import prepared_angles_deg
from tests.station.line.line_bench import DBC, command_frame


@pytest.mark.slow
def test_cycles_between_two_processes_come_one_to_one(tmp_path: Path) -> None:
    done: list[int] = []
    found = run_endurance(tmp_path, DBC, 40, done.append)
    assert found.wrong == ()
    assert done == list(range(1, 41))
    assert len(found.times) == len(found.station_rss_mb) == 40
    assert all(0 < times.first_result_s <= times.all_results_s for times in found.times)
    # Loose, because tests run beside each other; the study has the limits.
    assert found.percentile_ms("busy_s", 50) < 100
    assert max(found.growth_mb(20)) < 20


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PowerLossBench]:
    with open_power_loss(tmp_path, DBC) as bench:
        yield bench


@pytest.mark.slow(15)
def test_station_killed_at_steps_of_a_cycle(bench: PowerLossBench) -> None:
    names = bench.station_steps()
    assert names.index("before write_cycle") < names.index("before send_results")
    inserted = names.index("statement INSERT INTO wheel_results")
    committed = names.index("after write_cycle")
    offered = names.index("after record_event")
    assert committed < offered < names.index("before send_results")
    for step, ended, stored in (
        (inserted, "fault", False),
        (committed, "fault", True),
        (offered, "result", True),
    ):
        found = bench.kill_station(step, names[step])
        assert found.wrong == ()
        assert (found.ended, found.stored) == (ended, stored)


@pytest.mark.slow(12)
def test_controller_killed_at_steps_of_a_cycle(bench: PowerLossBench) -> None:
    names = bench.controller_steps()
    for step in (names.index("after journal order"), names.index("before journal result")):
        found = bench.kill_controller(step, names[step])
        assert found.wrong == ()
        assert found.ended == ("result" if names[step].endswith("result") else "fault")


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_while_cycles_run(tmp_path: Path, seed: int) -> None:
    found = run_noise(tmp_path, DBC, 10_000, seed, lambda done: None)
    assert found.wrong == []
    assert sum(found.frames.values()) == 10_000
    assert found.good_cycles >= 2
    assert found.health is not None
    assert found.health.bus.receive_failures == 0
    assert found.health.link.wrong_crc > 1000


@pytest.fixture(scope="module")
def database() -> LineDatabase:
    return load_line_database(DBC)


def test_every_kind_of_noise(database: LineDatabase) -> None:
    noise = Noise(database, Random(3))
    assert noise.make("flipped").arbitration_id in (0x100, 0x101, 0x102, 0x110)
    real = command_frame(database, "start", 5)
    noise.hear(real)
    assert noise.make("replayed").data == real.data
    for _ in range(50):
        flipped = noise.make("flipped")
        changed = sum((a ^ b).bit_count() for a, b in zip(flipped.data, real.data, strict=True))
        assert 1 <= changed <= 3
        assert len(noise.make("length").data) < 8
        assert database.name_of(noise.make("foreign")) is None
    strange = [noise.make("strange") for _ in range(50)]
    assert {frame.is_remote_frame for frame in strange} == {frame.is_error_frame for frame in strange}
    assert set(NOISE_KINDS) == {"random", "flipped", "replayed", "length", "strange", "foreign"}


def status(ready: bool, busy: bool, done: bool, fault: bool) -> LineStatus:
    return LineStatus(
        StationState.IDLE, 1, ready, busy, done, fault, 0, ErrorCode.NONE, 0, HandshakeState.READY
    )


def test_what_cannot_be_true_together() -> None:
    assert contradiction(status(True, False, False, False)) is None
    assert contradiction(status(False, False, False, True)) is None
    assert contradiction(status(True, True, False, False))
    assert contradiction(status(False, True, True, False))


def test_prepared_angles_tell_shots_apart() -> None:
    assert len({prepared_angles_deg(shot)[0] for shot in range(4000)}) == 4000
    assert all(abs(prepared_angles_deg(shot)[0]) <= 0.4 for shot in range(4000))
