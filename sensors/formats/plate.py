"""A plate: a TOML file, and its certificate if it has one.

Schema ``truewheel.plate/1`` is a plate with ring marks, ``truewheel.pattern-plate/1`` any other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from alignment.arrays import Array, Index, Mask
from alignment.counting import listed
from alignment.errors import ConfigurationError, DegenerateInputError, FormatError
from alignment.file_limits import TEXT
from alignment.imaging import RING_MARKED, Pattern, Plate
from sensors.formats.csv_table import table_of
from sensors.formats.files import read_bytes
from sensors.formats.pattern_plate import GridPoint, PatternPlateFile, ToleranceMm
from sensors.formats.validation import FilePath, Name, StrictModel, load_toml, validate

_CERTIFICATE_COLUMNS = ("i", "j", "x_mm", "y_mm", "sigma_mm")
_LARGEST_SIGMA_MM = 1.0
PATTERN_SCHEMA = "truewheel.pattern-plate/1"


class HollowGroup(StrictModel):
    """Ring marks that lie together, so that a camera which sees them knows where on the plate it looks."""

    marks: tuple[GridPoint, ...] = Field(
        min_length=3, max_length=100, description="Column and row of each ring mark of the group"
    )
    heads: tuple[Name, ...] | None = Field(
        default=None,
        min_length=1,
        max_length=16,
        description="Heads that see this group and no other; null when the arrangement alone tells. "
        "Needed where two groups are arranged alike",
    )

    def may_be_seen_by(self, head: str) -> bool:
        """Whether a head may see this group."""
        return self.heads is None or head in self.heads


class PlateFile(StrictModel):
    """What describes a plate."""

    schema_: Literal["truewheel.plate/1"] = Field(alias="schema", description="Kind and version of this file")
    name: Name = Field(description="Name of the plate")
    columns: GridPoint = Field(description="Index i of the first and of the last column; x = i · pitch")
    rows: GridPoint = Field(description="Index j of the first and of the last row; y = j · pitch")
    pitch_mm: float = Field(ge=0.5, le=1000, description="Distance of neighbouring marks, millimetres")
    mark_diameter_mm: float = Field(gt=0, le=1000, description="Diameter of every mark, millimetres")
    hollow_diameter_mm: float = Field(
        gt=0, le=1000, description="Diameter of the light centre of ring marks, millimetres"
    )
    mark_tolerance_mm: ToleranceMm = Field(
        default=0.01, description="Marks lie within ± this of the grid, in x and in y, millimetres"
    )
    flatness_tolerance_mm: ToleranceMm = Field(
        default=0.01, description="Marks lie within ± this of the plane, millimetres"
    )
    hollow_marks: tuple[HollowGroup, ...] = Field(
        min_length=1, max_length=16, description="The ring marks, in groups"
    )
    certificate: FilePath | None = Field(
        default=None,
        description="CSV file with the measured position of every mark, relative to this file's folder",
    )

    @model_validator(mode="after")
    def _is_plate(self) -> PlateFile:
        for name in ("columns", "rows"):
            first, last = getattr(self, name)
            if not first < last:
                raise DegenerateInputError(
                    field=name, expected="the first index, then a larger last one", seen=f"{first}, {last}"
                )
        if not self.hollow_diameter_mm < self.mark_diameter_mm < self.pitch_mm:
            raise DegenerateInputError(
                field="mark_diameter_mm",
                expected=f"more than the hollow diameter {self.hollow_diameter_mm:g} "
                f"and less than the pitch {self.pitch_mm:g}",
                seen=f"{self.mark_diameter_mm:g}",
            )
        self._check_hollow_marks()
        return self

    def _check_hollow_marks(self) -> None:
        every = [mark for group in self.hollow_marks for mark in group.marks]
        for i, j in every:
            if not (self.columns[0] <= i <= self.columns[1] and self.rows[0] <= j <= self.rows[1]):
                raise DegenerateInputError(
                    field="hollow_marks", expected="marks of the plate", seen=f"[{i}, {j}], outside its grid"
                )
            if every.count((i, j)) > 1:
                raise DegenerateInputError(
                    field="hollow_marks", expected="each mark once", seen=f"[{i}, {j}] twice"
                )
        for k, group in enumerate(self.hollow_marks):
            itself = _turns(group.marks)
            if len(set(itself + _turns(_mirrored(group.marks)))) < 8:
                raise DegenerateInputError(
                    field=f"hollow_marks[{k}].marks",
                    expected="an arrangement that no turn and no mirror maps onto itself, "
                    "such as an L of unequal legs",
                    seen="a symmetrical one",
                )
            for n, other in enumerate(self.hollow_marks[:k]):
                together = group.heads is None or other.heads is None or set(group.heads) & set(other.heads)
                alike = set(_turns(other.marks)) | set(_turns(_mirrored(other.marks)))
                if together and itself[0] in alike:
                    raise DegenerateInputError(
                        field=f"hollow_marks[{k}].marks",
                        expected=f"another arrangement than group {n}, which the same head may see",
                        seen="the same, shifted, turned or mirrored",
                        cure="Say under 'heads' which head sees which group",
                    )

    @property
    def indices(self) -> Index:
        """(M, 2) column and row of every mark, row by row."""
        j, i = np.mgrid[self.rows[0] : self.rows[1] + 1, self.columns[0] : self.columns[1] + 1]
        return np.column_stack([i.ravel(), j.ravel()]).astype(np.int64)

    def hollow(self, head: str | None = None) -> Mask:
        """(M,) which marks are rings; with a head only those that it may see."""
        marks = {
            mark
            for group in self.hollow_marks
            if head is None or group.may_be_seen_by(head)
            for mark in group.marks
        }
        return np.array([(int(i), int(j)) in marks for i, j in self.indices])

    def pattern_for(self, head: str | None = None) -> Pattern:
        """Return what the plate carries: ring marks, for every head."""
        return RING_MARKED

    def plate(self) -> Plate:
        """Return the plate with its marks where the grid says."""
        indices = self.indices
        # A tolerance of ±a, evenly distributed, has the standard uncertainty a/√3 (JCGM 100, 4.3.7).
        tolerances = [self.mark_tolerance_mm, self.mark_tolerance_mm, self.flatness_tolerance_mm]
        return Plate(
            indices=indices,
            points=np.column_stack([indices * self.pitch_mm, np.zeros(len(indices))]),
            sigma_mm=np.tile(np.array(tolerances) / math.sqrt(3.0), (len(indices), 1)),
            mark_radius_mm=self.mark_diameter_mm / 2,
            hollow=self.hollow(),
            hollow_radius_mm=self.hollow_diameter_mm / 2,
        )

    @property
    def grid_pitch_mm(self) -> tuple[float, float]:
        """Distances of neighbouring columns and rows, millimetres."""
        return self.pitch_mm, self.pitch_mm


AnyPlateFile = Annotated[PlateFile | PatternPlateFile, Field(discriminator="schema_")]
"""What describes a plate, of either kind."""


def _mirrored(marks: Iterable[GridPoint]) -> list[GridPoint]:
    return [(-i, j) for i, j in marks]


def _turns(marks: Iterable[GridPoint]) -> list[tuple[GridPoint, ...]]:
    """Return the arrangement in its four orientations, each shifted to the origin and sorted."""
    turned, points = [], list(marks)
    for _ in range(4):
        left, low = min(i for i, _ in points), min(j for _, j in points)
        turned.append(tuple(sorted((i - left, j - low) for i, j in points)))
        points = [(-j, i) for i, j in points]
    return turned


@dataclass(frozen=True, eq=False)
class PlateDescription:
    """A plate as its file and certificate describe it.

    Attributes
    ----------
    file
        What the file says.
    plate
        The marks, all ring marks among them: nominal positions, or the certificate's.
    certificate
        Content of the certificate's file, where there is one.
    """

    file: PlateFile | PatternPlateFile
    plate: Plate
    certificate: bytes | None = None

    def seen_by(self, head: str) -> Plate:
        """Return the plate as this head sees it, with only those ring marks as rings that it may see."""
        return replace(self.plate, hollow=self.file.hollow(head), pattern=self.file.pattern_for(head))


def read_plate(path: str | PathLike[str]) -> PlateDescription:
    """Read the description of a plate and its certificate.

    Raises
    ------
    ConfigurationError
        When the description is missing, is no TOML, or a field is missing, unknown or out of range.
    FormatError
        When the certificate is missing or cannot be read as the certificate of this plate.
    """
    path = Path(path)
    data = load_toml(path, "the description of a plate")
    file: PlateFile | PatternPlateFile
    if data.get("schema") == PATTERN_SCHEMA:
        file = validate(PatternPlateFile, data, file=path, error=ConfigurationError)
    else:
        file = validate(PlateFile, data, file=path, error=ConfigurationError)
    return describe_plate(file, path.parent)


def describe_plate(file: PlateFile | PatternPlateFile, folder: Path | None = None) -> PlateDescription:
    """Return a plate's description with its certificate, which lies in `folder`; errors as `read_plate`."""
    if file.certificate is None or folder is None:
        return PlateDescription(file, file.plate())
    path = folder / file.certificate
    content = read_bytes(path, "the certificate of a plate", TEXT)
    return PlateDescription(file, _certified(file.plate(), min(file.grid_pitch_mm), content, path), content)


def certified(
    file: PlateFile | PatternPlateFile, points: Array, sigma_mm: Array, name: str
) -> PlateDescription:
    """Return a plate with a certificate that states these positions.

    Parameters
    ----------
    file
        The plate; a certificate that it names already is replaced.
    points
        (M, 3) positions of the marks, rows as `PlateFile.indices`, millimetres.
    sigma_mm
        (M,) their standard uncertainty, millimetres.
    name
        File name of the certificate.
    """
    lines = [",".join((*_CERTIFICATE_COLUMNS[:4], "z_mm", _CERTIFICATE_COLUMNS[4]))]
    lines += [
        ",".join([str(i), str(j), *(repr(float(value)) for value in (*point, u))])
        for (i, j), point, u in zip(file.indices.tolist(), points, sigma_mm, strict=True)
    ]
    content = ("\n".join(lines) + "\n").encode()
    file = file.model_copy(update={"certificate": name})
    return PlateDescription(
        file, _certified(file.plate(), min(file.grid_pitch_mm), content, Path(name)), content
    )


def _certified(nominal: Plate, pitch_mm: float, content: bytes, path: Path) -> Plate:
    """Return the plate with the positions of its certificate.

    A certificate without heights leaves them as the plate's description says.
    """
    points, sigma = nominal.points.copy(), nominal.sigma_mm.copy()
    rows = {(int(i), int(j)): row for row, (i, j) in enumerate(nominal.indices)}
    left = set(rows)
    for line in table_of(content, path, _CERTIFICATE_COLUMNS, optional=("z_mm",), comments=True):
        coordinates = ["x_mm", "y_mm", "z_mm"] if "z_mm" in line.cells else ["x_mm", "y_mm"]
        axes, where = list(range(len(coordinates))), f"line {line.number}"
        mark = line.whole("i"), line.whole("j")
        values = np.array([float(line.decimal(name)) for name in coordinates])
        uncertainty = float(line.decimal("sigma_mm"))
        if not 0 < uncertainty <= _LARGEST_SIGMA_MM:
            raise line.error(
                "sigma_mm", f"a number above 0, at most {_LARGEST_SIGMA_MM:g}", line.cells["sigma_mm"]
            )
        if mark not in left:
            known = "a mark that an earlier line has" if mark in rows else "none of its marks"
            raise FormatError(
                file=path,
                field=where,
                expected="each mark of the plate once",
                seen=f"{known}: [{listed(mark)}]",
                cure="Use the certificate of this plate",
            )
        left.remove(mark)
        row = rows[mark]
        far = float(np.abs(values - points[row, axes]).max())
        if not far < pitch_mm / 4:
            raise FormatError(
                file=path,
                field=where,
                expected=f"mark [{listed(mark)}] near its place in the grid",
                seen=f"{far:g} mm from there",
                cure="Check that it is this plate's certificate, in millimetres, with its origin and axes",
            )
        points[row, axes] = values
        sigma[row, axes] = uncertainty
    if left:
        raise FormatError(
            file=path,
            expected=f"all {len(rows)} marks of the plate",
            seen=f"{len(left)} missing, the first [{listed(min(left))}]",
            cure="Use the whole certificate of this plate",
        )
    return replace(nominal, points=points, sigma_mm=sigma)
