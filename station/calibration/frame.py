"""`truewheel calibration frame`: all rigs are put into the vehicle frame by one view of a gauge frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from alignment.calibration import (
    CalibrationInput,
    CertifiedPlate,
    PlacedRig,
    judge_placing,
    place_rig,
    placing_in_doubt,
    predicted_u95,
    transfer_u95,
)
from alignment.errors import ConfigurationError, Deed, FormatError, Remedy
from alignment.units import ARCMIN
from alignment.values import RigCalibration
from db.records import CalibrationRecord
from db.store import ResultStore
from sensors.formats import (
    SESSION_FILE,
    CalibrationFile,
    GaugeFrame,
    PlateDescription,
    PlateSession,
    describe_calibration,
    dump_json,
    entries,
    read_calibration_file,
    read_plate_session,
    write_folder,
)
from station.calibration.calibrate import calibration_id
from station.calibration.observing import KnownCameras, observe_session
from station.figures import Progress


@dataclass(frozen=True, eq=False)
class FramedRig:
    """What the gauge frame said of one rig.

    Attributes
    ----------
    rig
        Its name.
    before
        Identity of its calibration until now.
    problem
        The sentence that refuses it; None when its pose was found.
    placed
        What was found; None where the plate was not recognised.
    calibration
        With the new pose and an identity of its own; None when refused.
    forced_reason
        Why a pose that is not believed counts all the same; None where it is believed.
    remedy
        What can be done about the problem, where a surface has its own way to it.
    """

    rig: str
    before: str
    problem: str | None
    placed: PlacedRig | None
    calibration: RigCalibration | None
    forced_reason: str | None = None
    remedy: Remedy | None = None


def place_rigs(
    folder: Path,
    frame: GaugeFrame,
    calibrations: Sequence[Path],
    now_utc: datetime,
    progress: Progress,
    forced_reason: str | None = None,
) -> tuple[FramedRig, ...]:
    """Find the pose of every rig in the vehicle from a gauge session.

    Parameters
    ----------
    folder
        Gauge session: a folder with a plate session for each rig, one view each, taken while the frame stood
        still.
    frame
        The gauge frame.
    calibrations
        File of each rig's cameras.
    now_utc
        Time of the calibration, aware; part of the new identities.
    progress
        Told how far it is.
    forced_reason
        Why poses that are in doubt shall count all the same. None to refuse them.

    Raises
    ------
    FormatError
        When a session or a calibration cannot be read, or a session shows another plate than the frame's.
    ConfigurationError
        When sessions, calibrations and the frame's plates are not of the same rigs.
    DegenerateInputError
        When a session's cameras are not those of its calibration, or it has more than one view.
    """
    sessions = _read_sessions(folder)
    known = _read_calibrations(calibrations)
    _check_rigs(sessions, known, frame, folder)
    out = []
    for number, (rig, session) in enumerate(sessions.items()):
        progress(number / len(sessions), f"marks of {rig}")
        out.append(_place(session, known[rig].calibration(), frame, now_utc, forced_reason))
    return tuple(out)


def _place(
    session: PlateSession,
    known: RigCalibration,
    frame: GaugeFrame,
    now_utc: datetime,
    forced_reason: str | None,
) -> FramedRig:
    # The frame's own description counts: it has the certificate.
    plate = frame.plates[session.rig].plate
    session = replace(session, plate=plate)
    turn = known.vehicle_from_rig.rotation.T @ frame.plates[session.rig].vehicle_from_plate.rotation
    views, refusals = observe_session(session, lambda done, doing: None, KnownCameras(known, turn))
    if refusals:
        listed = "; ".join(f"{' '.join(key)}: {refusal.reason}" for _, key, refusal in refusals[:3])
        return FramedRig(session.rig, known.id, f"the plate was not recognised: {listed}", None, None)
    data = CalibrationInput(plate.plate, views, dict(session.sizes))
    certified = CertifiedPlate(
        frame.plates[session.rig].vehicle_from_plate,
        frame.file.position_sigma_mm,
        frame.file.angle_sigma_arcmin * ARCMIN,
        f"{frame.file.name}, seen {now_utc.isoformat(timespec='seconds')}",
        frame.file.whole.covariance(),
    )
    placed = place_rig(data, known, certified)
    return judged_rig(placed, known, now_utc, forced_reason)


def judged_rig(
    placed: PlacedRig, known: RigCalibration, now_utc: datetime, forced_reason: str | None = None
) -> FramedRig:
    """Accept a placed rig with an identity of its own, or refuse it; what is in doubt needs a reason."""
    problem, doubt = judge_placing(placed), placing_in_doubt(placed)
    if problem is None and doubt is not None and forced_reason is None:
        return FramedRig(known.rig, known.id, doubt, placed, None, remedy=Remedy(Deed.FORCE))
    if problem is not None:
        return FramedRig(known.rig, known.id, problem, placed, None)
    new = replace(placed.calibration, id=calibration_id(placed.calibration, now_utc))
    return FramedRig(known.rig, known.id, None, placed, new, None if doubt is None else forced_reason)


def _read_sessions(folder: Path) -> dict[str, PlateSession]:
    found: dict[str, PlateSession] = {}
    for path in entries(folder, SESSION_FILE, "plate sessions"):
        session = read_plate_session(path.parent)
        if session.rig in found:
            raise FormatError(
                file=path, field="rig", expected="one session for each rig", seen=f"'{session.rig}' again"
            )
        found[session.rig] = session
    if not found:
        seen = "none" if folder.is_dir() else "no such folder"
        raise FormatError(
            file=folder,
            expected=f"a gauge session: folders with {SESSION_FILE}, one for each rig",
            seen=seen,
        )
    return found


def _read_calibrations(paths: Sequence[Path]) -> dict[str, CalibrationFile]:
    found: dict[str, CalibrationFile] = {}
    for path in paths:
        file = read_calibration_file(path)
        if file.rig in found:
            raise ConfigurationError(
                file=path, choice="calibration", expected="one for each rig", seen=f"two of '{file.rig}'"
            )
        found[file.rig] = file
    return found


def _check_rigs(
    sessions: dict[str, PlateSession], known: dict[str, CalibrationFile], frame: GaugeFrame, folder: Path
) -> None:
    for what, there in (("a calibration", set(known)), ("a plate of the gauge frame", set(frame.plates))):
        missing = [rig for rig in sessions if rig not in there]
        if missing:
            raise ConfigurationError(
                choice="calibration" if there == set(known) else "frame",
                expected=f"{what} for each rig of the session: {', '.join(sessions)}",
                seen=f"none for {', '.join(missing)}",
            )
    unseen = [rig for rig in known if rig not in sessions]
    if unseen:
        raise ConfigurationError(
            file=folder,
            expected="a session for each calibration",
            seen=f"none for {', '.join(unseen)}",
            cure="Leave these calibrations out, or take their images too.",
        )
    for rig, session in sessions.items():
        if _layout(session.plate) != _layout(frame.plates[rig].plate):
            raise FormatError(
                file=folder / rig / SESSION_FILE,
                field="plate",
                expected=f"the gauge frame's plate '{frame.plates[rig].plate.file.name}' for this rig",
                seen=f"'{session.plate.file.name}' with other marks",
            )


def _layout(plate: PlateDescription) -> dict[str, Any]:
    """What tells plates apart, whatever is known of their errors."""
    return plate.file.model_dump(exclude={"certificate", "mark_tolerance_mm", "flatness_tolerance_mm"})


def keep(
    out: Path, framed: Sequence[FramedRig], frame: GaugeFrame, now_utc: datetime, database: str | None
) -> dict[str, Path]:
    """Store the new calibrations in the database, then write them into a new folder, all or none.

    Returns
    -------
    dict
        File of each rig.

    Raises
    ------
    StoreError
        When the database cannot be used; nothing is written then.
    FormatError
        When the folder holds something or cannot be written.
    """
    files: dict[str, CalibrationFile] = {}
    for each in framed:
        assert each.calibration is not None
        name = f"{each.rig}.json"
        forced = "" if each.forced_reason is None else f"FORCED: {each.forced_reason}; "
        method = f"{forced}{each.before}, placed by gauge frame {frame.file.name}"
        files[name] = describe_calibration(
            each.calibration, method=method[:200], created_utc=now_utc, path=out / name
        )
    if database is not None:
        with ResultStore(database) as store:
            for file in files.values():
                document = file.model_dump(mode="json", by_alias=True)
                store.record_calibration(CalibrationRecord(file.id, file.rig, file.created_utc, document))
    write_folder(out, {name: dump_json(file) for name, file in files.items()})
    return {file.rig: out / name for name, file in files.items()}


def framed_as_json(
    framed: Sequence[FramedRig], files: dict[str, Path], told: Callable[[Remedy], str] = str
) -> dict[str, Any]:
    """Return what ``truewheel calibration frame --json`` prints; `told` words a remedy."""
    refused = [f"{each.rig}: {each.problem}" for each in framed if each.problem is not None]
    placed = [each.placed for each in framed if each.placed is not None]
    return {
        "outcome": "refused" if refused else "accepted",
        "reason": "; ".join(refused) or None,
        "rigs": [_rig_as_json(each, files.get(each.rig), told) for each in framed],
        "figures": {
            "largest_transfer_u95_arcmin": max((transfer_u95(p) / ARCMIN for p in placed), default=None),
            "largest_angle_change_arcmin": max(
                (max(abs(p.camber_change), abs(p.toe_change)) / ARCMIN for p in placed), default=None
            ),
        },
    }


def _rig_as_json(framed: FramedRig, file: Path | None, told: Callable[[Remedy], str]) -> dict[str, Any]:
    result: dict[str, Any] = {
        "rig": framed.rig,
        "outcome": "accepted" if framed.problem is None else "refused",
        "reason": framed.problem,
        "remedy": None if framed.remedy is None else told(framed.remedy),
        "predecessor_id": framed.before,
        "calibration_id": None if framed.calibration is None else framed.calibration.id,
        "calibration": None if file is None else str(file),
        "forced_reason": framed.forced_reason,
    }
    if framed.placed is None:
        return result
    placed = framed.placed
    predicted = predicted_u95(placed)
    camber, toe = (None, None) if predicted is None else map(math.degrees, predicted)
    return result | {
        "residual_rms_px": placed.rms_px,
        "marks": sum(placed.marks.values()),
        "camber_change_arcmin": placed.camber_change / ARCMIN,
        "toe_change_arcmin": placed.toe_change / ARCMIN,
        "turn_from_nominal_deg": math.degrees(placed.turn_from_nominal),
        "position_mm": placed.calibration.vehicle_from_rig.translation.tolist(),
        "position_u95_mm": (2.0 * np.sqrt(np.diag(placed.pose_covariance)[3:])).tolist(),
        "transfer_u95_arcmin": transfer_u95(placed) / ARCMIN,
        "predicted_camber_u95_deg": camber,
        "predicted_toe_u95_deg": toe,
    }
