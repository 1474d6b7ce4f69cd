"""What a station keeps of its images."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from alignment.errors import DegenerateInputError
from sensors.formats import FilePath, StrictModel

KeptFor = Literal["nok", "refused", "fault"]
"""Why all images of a cycle are kept: a value out of its limits, a wheel refused, a wheel that failed."""


class ArchiveSettings(StrictModel):
    """Where images are kept, and how long; older ones make room for newer ones."""

    folder: FilePath = Field(description="Folder of the images, relative to this file")
    keep: Literal["all", "evidence"] | tuple[KeptFor, ...] = Field(
        default="all",
        description="'all' images, or as 'evidence' only those of wheels that were NOK, refused or failed; or"
        " a list of 'nok', 'refused', 'fault': all images of cycles with such a wheel or verdict",
    )
    every: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000,
        description="Beside that all images of every so many-th cycle, counted from the start of the program",
    )
    most_gb: float = Field(default=100.0, gt=0, le=1e6, description="Largest size of all images, gigabytes")
    ordinary_days: float = Field(
        default=14.0, gt=0, le=36_500, description="Longest time of images of good wheels, days"
    )
    evidence_days: float = Field(
        default=365.0, gt=0, le=36_500, description="Longest time of images of all other wheels, days"
    )
    series_mb: float = Field(
        default=2000.0,
        ge=0,
        le=1e6,
        description="Memory for the exposures of wheels that turn until they are archived, megabytes; a"
        " series that finds no room is measured and not archived",
    )

    closing_s: float = Field(
        default=120.0,
        ge=1,
        le=3600,
        description="Longest wait at the station's end for images that are not written yet, seconds; what is"
        " left then is lost, and told by cycle and wheel",
    )

    @model_validator(mode="after")
    def _keeps_something(self) -> ArchiveSettings:
        if self.keep == "all" and self.every is not None:
            raise DegenerateInputError(
                field="every",
                expected="none with keep = 'all', which keeps every cycle",
                seen=str(self.every),
                cure="Say what else is to be kept, such as keep = ['nok', 'refused'], or leave it out",
            )
        if self.keep == () and self.every is None:
            raise DegenerateInputError(
                field="keep",
                expected="'all', 'evidence', or a list of some of 'nok', 'refused', 'fault'",
                seen="an empty list",
                cure="To keep every n-th cycle alone say every = n; to keep nothing leave [archive] out",
            )
        if len(set(self.keep)) < len(self.keep) and not isinstance(self.keep, str):
            raise DegenerateInputError(field="keep", expected="each reason once", seen=", ".join(self.keep))
        return self
