"""``archived.json`` beside the images of a wheel: everything to measure it again, and what was found."""

from __future__ import annotations

import hashlib
import json
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal
from uuid import UUID

from pydantic import AwareDatetime, Field, model_validator

from alignment.errors import DegenerateInputError, FormatError
from alignment.values import PlaneMethod
from alignment.wheel import FEWEST_EXPOSURES, MOST_EXPOSURES
from sensors.formats.files import read_bytes
from sensors.formats.validation import Name, StrictModel, dump_json, load_json, validate

ARCHIVED_FILE = "archived.json"
ARCHIVED_CALIBRATION = "calibration.json"
_KIND = "the record of archived images"
_Angle = Annotated[float, Field(ge=-3.2, le=3.2)]
_Sigma = Annotated[float, Field(ge=0, le=3.2)]
_Millimetres = Annotated[float, Field(ge=0, le=1e6)]
_Depth = Annotated[float, Field(ge=-500, le=500)]
_Text = Annotated[str, Field(max_length=2000)]
_Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_Place = Annotated[str, Field(pattern=r"^([A-Za-z0-9_-]{1,64}/)?[A-Za-z0-9][A-Za-z0-9 _.-]{0,210}$")]


class ArchivedSettings(StrictModel):
    """What the measurement was told; as `alignment.values.MeasureSettings`."""

    depth_range_mm: tuple[_Depth, _Depth] = Field(
        description="Lowest and highest z of the tyre's surface in the rig frame"
    )
    method: PlaneMethod = Field(description="How the tyre plane is found from the points")
    minimum_points: int = Field(ge=1, le=1_000_000, description="Fewer points per head refuse it")
    maximum_angle: float = Field(gt=0, le=3.2, description="Largest believable camber or toe, radians")
    coverage_factor: float = Field(gt=0, le=10, description="k of the expanded uncertainty")
    allow_lost_head: bool = Field(description="Whether the other heads measure when one is lost")
    judge_heads: bool = Field(
        default=True, description="Whether signs of moved heads are judged; of a series they are together"
    )
    needs_place: bool = Field(description="Whether a wheel whose place is not seen is refused")


class ArchivedZero(StrictModel):
    """The zero measurement that corrected the angles, radians."""

    id: str = Field(min_length=1, max_length=200, description="As in the database")
    measured_utc: AwareDatetime = Field(description="When the master wheel was measured")
    master: _Text = Field(description="Name of the master wheel")
    method: _Text = Field(description="How the master was measured")
    shots: int = Field(ge=1, le=100_000, description="Of the master")
    camber: _Angle = Field(description="Of the master, as measured")
    toe: _Angle = Field(description="Of the master, as measured")
    certified_camber: _Angle = Field(description="Of the master, as certified")
    certified_toe: _Angle = Field(description="Of the master, as certified")
    camber_u: _Sigma = Field(description="Standard uncertainty of measured less certified camber")
    toe_u: _Sigma = Field(description="Standard uncertainty of measured less certified toe")
    correlation: float = Field(ge=-1, le=1, description="Of the two")
    software_version: _Text = Field(description="Of the program that measured the master")


class ArchivedSeries(StrictModel):
    """What a series of exposures had to be."""

    exposures: int = Field(ge=FEWEST_EXPOSURES, le=MOST_EXPOSURES, description="How many it was to have")
    least_turn: float = Field(ge=2.0, le=130, description="Least turn that they must cover, radians")


class ArchivedResult(StrictModel):
    """What was found, as it was measured in front of the rig: toe against the stand's axis; radians.

    None is what a result of its kind does not have.
    """

    outcome: Literal["measured", "refused", "fault"] = Field(description="What became of the wheel")
    reason_code: str | None = Field(default=None, max_length=200, description="Why not, for programs")
    reason_text: _Text | None = Field(default=None, description="Why not, for people")
    camber: _Angle | None = Field(default=None, description="Corrected by the zero measurement")
    toe: _Angle | None = Field(default=None, description="Corrected by the zero measurement")
    camber_u: _Sigma | None = Field(default=None, description="Standard uncertainty")
    toe_u: _Sigma | None = Field(default=None, description="Standard uncertainty")
    points_used: int | None = Field(default=None, ge=0, le=10**9, description="Points that carried weight")
    residual_rms_mm: _Millimetres | None = Field(default=None, description="RMS of their residuals")
    method: str | None = Field(default=None, max_length=200, description="How, and of what")
    degraded: bool | None = Field(default=None, description="Whether a head was lost")
    load_mm: _Millimetres | None = Field(default=None, description="Of the sidewall, which was taken off")
    row_px: float | None = Field(default=None, ge=0, le=1e6, description="Largest epipolar residual, pixels")
    knock_evidence: float | None = Field(
        default=None, ge=-1e300, le=1e300, description="2 ln of the evidence that a camera moved"
    )
    camber_unseen: _Sigma | None = Field(default=None, description="What no image shows may change it by")
    toe_unseen: _Sigma | None = Field(default=None, description="What no image shows may change it by")
    run_out: _Angle | None = Field(default=None, description="Between tyre plane and spin axis")
    run_out_u: _Sigma | None = Field(default=None, description="Standard uncertainty")
    high_spot: float | None = Field(
        default=None, ge=-7, le=7, description="Where the tyre stood out farthest at the last exposure"
    )
    high_spot_u: float | None = Field(default=None, ge=0, le=1e6, description="Standard uncertainty")
    covered_turn: float | None = Field(default=None, ge=0, le=7, description="Turn that was covered")
    turned: float | None = Field(default=None, ge=-1000, le=1000, description="From first to last exposure")
    wander: _Sigma | None = Field(default=None, description="Largest angle of the axis from its mean")
    shots_used: int | None = Field(
        default=None, ge=0, le=MOST_EXPOSURES, description="Exposures that counted"
    )


class ArchivedContent(StrictModel):
    """One file of the folder, as it was written."""

    sha256: _Hash = Field(description="Of its content")
    bytes: int = Field(ge=0, le=2**40, description="Its size")


class ArchivedFile(StrictModel):
    """What ``archived.json`` holds."""

    schema_: Literal["truewheel.archived/1"] = Field(
        alias="schema", description="Kind and version of this file"
    )
    cycle: str = Field(min_length=36, max_length=36, description="UUID of the cycle in the database")
    station: str = Field(min_length=1, max_length=200, description="That measured")
    wheel: Name = Field(description="Name of the wheel, which is its rig's")
    vin: str | None = Field(default=None, max_length=200, description="Of the vehicle")
    vehicle_type: str | None = Field(default=None, max_length=200, description="Whose limits applied")
    received_utc: AwareDatetime = Field(description="When the trigger came")
    software_version: str = Field(min_length=1, max_length=200, description="That measured")
    environment: dict[Annotated[str, Field(max_length=100)], Annotated[str, Field(max_length=300)]] = Field(
        max_length=50, description="Libraries, interpreter, processor and the hash of the program's own code"
    )
    config_hash: str = Field(min_length=1, max_length=200, description="Of the station's configuration")
    measure: Literal["tyre_plane", "spin_axis"] = Field(description="What was measured")
    tyre_width_mm: float | None = Field(
        default=None, ge=1, le=1000, description="Section width of this axle's tyres; null when unknown"
    )
    tyre_width_sigma_mm: float | None = Field(
        default=None, ge=0, le=100, description="Spread of single tyres about it; null when unknown"
    )
    series: ArchivedSeries | None = Field(default=None, description="Of a spin axis; null of a tyre plane")
    settings: ArchivedSettings = Field(description="What the measurement was told")
    calibration_id: str = Field(min_length=1, max_length=200, description="Identity of the calibration")
    zero: ArchivedZero | None = Field(default=None, description="That corrected; null when there was none")
    result: ArchivedResult = Field(description="What was found")
    shots: tuple[Annotated[str, Field(pattern=r"^(\.|turn_[0-9]{2,3})$")], ...] = Field(
        min_length=1, max_length=MOST_EXPOSURES, description="Folders of the exposures, in their order"
    )
    files: dict[_Place, ArchivedContent] = Field(
        min_length=1, max_length=4000, description="Every other file of the folder"
    )
    sha256: _Hash = Field(description="Of all of the above, so that a change of it is noticed")

    @model_validator(mode="after")
    def _is_consistent(self) -> ArchivedFile:
        try:
            UUID(self.cycle)
        except ValueError:
            raise DegenerateInputError(field="cycle", expected="a UUID", seen=f"'{self.cycle}'") from None
        if (self.measure == "spin_axis") != (self.series is not None):
            raise DegenerateInputError(
                field="series", expected="the rules of the series for a spin axis, and for it alone",
                seen="none" if self.series is None else "some",
            )  # fmt: skip
        return self


def digest_of(fields: dict[str, Any]) -> str:
    """Return the SHA-256 of the fields of a record but its own: JSON, names sorted, no spaces, ASCII."""
    rest = {name: value for name, value in fields.items() if name != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def archived_bytes(fields: dict[str, Any], folder: Path) -> bytes:
    """Return the content of ``archived.json`` of these fields, with their digest; errors as `validate`."""
    described = validate(ArchivedFile, fields | {"sha256": 64 * "0"}, file=folder / ARCHIVED_FILE)
    plain = described.model_dump(mode="json", by_alias=True)
    return dump_json(described.model_copy(update={"sha256": digest_of(plain)}))


def read_archived(folder: str | PathLike[str]) -> ArchivedFile:
    """Read the record of a folder of archived images.

    Raises
    ------
    FormatError
        When it is missing, damaged, of another version, or was changed since it was written.
    """
    path = Path(folder) / ARCHIVED_FILE
    data = load_json(path, _KIND)
    found = validate(ArchivedFile, data, file=path)
    if digest_of(data) != found.sha256:
        raise FormatError(
            file=path,
            field="sha256",
            expected="the digest of the other fields",
            seen="that of others: the file was changed since it was written",
            cure="Take the folder from a backup",
        )
    return found


def archived_hash(folder: str | PathLike[str]) -> str:
    """Return the SHA-256 of ``archived.json`` itself, which the database holds; errors as `read_bytes`."""
    return hashlib.sha256(read_bytes(Path(folder) / ARCHIVED_FILE, _KIND)).hexdigest()


def changed_files(folder: str | PathLike[str], record: ArchivedFile) -> dict[str, str]:
    """Return what became of the files of a folder since: by name, in words; empty when all are as written."""
    found: dict[str, str] = {}
    for name, known in record.files.items():
        path = Path(folder) / name
        try:
            content = read_bytes(path, "a file of archived images")
        except FormatError as error:
            found[name] = "is missing" if not path.exists() else f"cannot be read: {error.seen}"
            continue
        if len(content) != known.bytes:
            found[name] = f"has {len(content)} bytes, not {known.bytes}"
        elif hashlib.sha256(content).hexdigest() != known.sha256:
            found[name] = "has another content than was written"
    return found
