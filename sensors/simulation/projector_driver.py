"""The driver ``simulated`` of projectors: it lights the wheels of a simulated rig."""

from __future__ import annotations

from pydantic import Field

from alignment.errors import ProjectorError
from sensors.formats.validation import StrictModel
from sensors.projectors import ProjectorDriver, ProjectorPlace, ProjectorState


class SimulatedProjectorOptions(StrictModel):
    """A projector that lights simulated wheels; before other cameras it only answers."""

    wear: float = Field(default=0.0, ge=0, le=0.99, description="Share of its light that is lost to age")


class SimulatedProjector:
    """Lights whatever has a `lamp`.

    Parameters
    ----------
    rig
        That it lights.
    lit
        The rig, whose attribute `lamp` it sets where it has one.
    wear
        Share of its light that is lost; may be exchanged at any time.
    """

    can_be_dark = True

    def __init__(self, rig: str, lit: object = None, wear: float = 0.0) -> None:
        self.rig = rig
        self.wear = wear
        self.failing = False
        self._lit = lit
        self._connected = False
        self._brightness, self._on = 1.0, False

    def connect(self) -> None:
        """Reach it."""
        self._answer()
        self._connected = True

    def light(self, brightness: float) -> None:
        """Light the wheel."""
        self._require_connection()
        self._brightness, self._on = brightness, True
        self._shine(brightness * (1.0 - self.wear))

    def dark(self) -> None:
        """Leave the wheel dark."""
        self._require_connection()
        self._on = False
        self._shine(0.0)

    def state(self) -> ProjectorState:
        """Return how it was set."""
        self._require_connection()
        return ProjectorState("simulated projector", self._on, self._brightness)

    def close(self) -> None:
        """Go dark."""
        self._connected = self._on = False
        self._shine(0.0)

    def _shine(self, share: float) -> None:
        if hasattr(self._lit, "lamp"):
            self._lit.lamp = share

    def _require_connection(self) -> None:
        if not self._connected:
            raise ProjectorError(self.rig, "is not connected", "Connect it first")
        self._answer()

    def _answer(self) -> None:
        if self.failing:
            self._connected = False
            raise ProjectorError(self.rig, "expected an answer, none came", "Check its power and its cable")


def _make(options: SimulatedProjectorOptions, place: ProjectorPlace) -> SimulatedProjector:
    return SimulatedProjector(place.rig, place.cameras, options.wear)


DRIVER = ProjectorDriver(SimulatedProjectorOptions, _make, in_process=True)
"""The driver ``simulated``."""
