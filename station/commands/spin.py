"""`truewheel measure --spin`: the spin axis from shots of a wheel that was turned between them."""

from __future__ import annotations

import math
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from alignment.units import in_degrees
from station.commands.output import print_json
from station.commands.warm_up import compiled_for_images

if TYPE_CHECKING:
    from alignment.values import MeasureSettings, Refusal
    from alignment.wheel import SpinMeasurement


_TURN = re.compile(r"turn_(\d{1,4})")


def measure_turned_wheel(
    shots: list[Path], calibration: Path, settings: MeasureSettings, radius_mm: float, as_json: bool
) -> bool:
    """Measure, print, and tell whether there is a result."""
    from alignment.measure_spin import measure_spin
    from sensors.formats import read_calibration, read_shot

    known = read_calibration(calibration)
    compiled_for_images(read_shot(shots[0], known).images, as_json, "spin")
    started = time.perf_counter()
    images = (read_shot(shot, known).images for shot in shots)
    found = measure_spin(images, known, settings, numbers=numbers_of(shots))
    result = spin_as_json(found, shots, radius_mm) | {
        "duration_ms": 1000.0 * (time.perf_counter() - started),
        "calibration_id": known.id,
    }
    if as_json:
        print_json(result)
    else:
        _print(result)
    return bool(found)


def numbers_of(shots: list[Path]) -> list[int] | None:
    """Return the numbers of shots that are one series, ``turn_01``, ``turn_02``, … of a folder; else None."""
    named = [_TURN.fullmatch(shot.name) for shot in shots]
    one = len({shot.resolve().parent for shot in shots}) == 1
    return [int(match[1]) for match in named if match] if one and all(named) else None


def spin_as_json(found: SpinMeasurement | Refusal, shots: list[Path], radius_mm: float) -> dict[str, Any]:
    """Return what `truewheel measure --spin --json` prints of a result."""
    from alignment.values import Refusal

    result: dict[str, Any] = {
        "outcome": "refused",
        "reason": None,
        "reason_code": None,
        "camber_deg": None,
        "toe_deg": None,
        "camber_u95_deg": None,
        "toe_u95_deg": None,
        "runout_deg": None,
        "runout_u95_deg": None,
        "runout_mm": None,
        "runout_radius_mm": radius_mm,
        "covered_turn_deg": None,
        "turned_deg": None,
        "high_spot_deg": None,
        "high_spot_u95_deg": None,
        "wander_deg": None,
        "shots_used": None,
        "shots": [{"shot": str(shot), "used": None, "phase_deg": None} for shot in shots],
        "method": None,
        "degraded": None,
    }
    if isinstance(found, Refusal):
        return result | {"reason": found.reason, "reason_code": str(found.code)}
    phases = found.phases or (None,) * len(shots)
    return result | {
        "outcome": "measured",
        "camber_deg": math.degrees(found.camber),
        "toe_deg": math.degrees(found.toe),
        "camber_u95_deg": math.degrees(found.camber_u95),
        "toe_u95_deg": math.degrees(found.toe_u95),
        "runout_deg": in_degrees(found.run_out),
        "runout_u95_deg": math.degrees(found.coverage_factor * found.run_out_u),
        "runout_mm": found.run_out_mm(radius_mm),
        "covered_turn_deg": in_degrees(found.covered_turn),
        "turned_deg": in_degrees(found.turned),
        "high_spot_deg": in_degrees(found.high_spot),
        "high_spot_u95_deg": None
        if found.high_spot_u is None
        else math.degrees(found.coverage_factor * found.high_spot_u),
        "wander_deg": in_degrees(found.wander),
        "shots_used": found.shots_used,
        "shots": [
            {"shot": str(shot), "used": used, "phase_deg": in_degrees(phase)}
            for shot, used, phase in zip(shots, found.used, phases, strict=True)
        ],
        "method": found.method,
        "degraded": found.degraded,
    }


def _print(result: dict[str, Any]) -> None:
    if result["outcome"] != "measured":
        typer.echo(f"refused ({result['reason_code']}): {result['reason']}")
        return
    typer.echo(f"camber {result['camber_deg']:+.4f}° ± {result['camber_u95_deg']:.4f}°, spin axis")
    typer.echo(f"toe    {result['toe_deg']:+.4f}° ± {result['toe_u95_deg']:.4f}°, spin axis")
    if result["runout_deg"] is None:
        typer.echo(
            f"run-out not told from noise, at most about {result['runout_u95_deg']:.4f}°: how far the wheel "
            "turned is unknown"
        )
    else:
        typer.echo(
            f"run-out {result['runout_deg']:.4f}° ± {result['runout_u95_deg']:.4f}°, "
            f"{result['runout_mm']:.3f} mm peak to peak at {result['runout_radius_mm']:g} mm, turn covered "
            f"{result['covered_turn_deg']:.0f}°"
        )
        typer.echo(
            f"high spot at the last shot {result['high_spot_deg']:.0f}° ± {result['high_spot_u95_deg']:.1f}° "
            "counter-clockwise of the top, seen from outboard"
        )
    if result["wander_deg"] is not None:
        typer.echo(f"the axis wandered by up to {60.0 * result['wander_deg']:.2f}′; the result is its mean")
    typer.echo(
        f"{result['shots_used']} of {len(result['shots'])} shots used"
        + (", degraded: a head was lost" if result["degraded"] else "")
        + f", calibration {result['calibration_id']}"
    )
