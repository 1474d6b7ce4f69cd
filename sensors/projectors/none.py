"""The driver ``none``: a projector that the strobe line alone lights, its brightness set by hand."""

from __future__ import annotations

from alignment.errors import ProjectorError
from sensors.formats.validation import StrictModel
from sensors.projectors.driver import ProjectorDriver, ProjectorPlace
from sensors.projectors.projector import ProjectorState


class NoneOptions(StrictModel):
    """A projector that cannot be talked to has no settings."""


class UnspokenProjector:
    """Lights at every strobe, as bright as somebody set it."""

    can_be_dark = False

    def __init__(self, rig: str) -> None:
        self.rig = rig

    def connect(self) -> None:
        """Nothing to reach."""

    def light(self, brightness: float) -> None:
        """It always does."""

    def dark(self) -> None:
        """Refuse: it lights whenever the cameras expose."""
        raise ProjectorError(
            self.rig,
            "expected one that can be dark, it is lit by the strobe line alone",
            "Name the driver that switches it in [rigs.projector], or take no dark exposures",
        )

    def state(self) -> ProjectorState:
        """Return that nothing is known."""
        return ProjectorState()

    def close(self) -> None:
        """Nothing to let go."""


def _make(options: NoneOptions, place: ProjectorPlace) -> UnspokenProjector:
    return UnspokenProjector(place.rig)


DRIVER = ProjectorDriver(NoneOptions, _make, can_be_dark=False, adjustable=False, in_process=True)
"""The driver ``none``."""
