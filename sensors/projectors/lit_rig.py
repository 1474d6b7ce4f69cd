"""A rig with its projector: lit when it is armed, and dark for a second exposure where one is wanted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from alignment.errors import ConfigurationError, SeveralErrors, TruewheelError
from sensors.camera import Camera
from sensors.projectors.guarded import driver_failed
from sensors.projectors.projector import ProjectorDevice, ProjectorState
from sensors.rig import Rig
from sensors.shot import WheelShot


@dataclass(frozen=True)
class RigLight:
    """How a rig is lit.

    Attributes
    ----------
    brightness
        Share of the projector's full light, above 0 and at most 1.
    dark
        Whether every shot has a second exposure without that light, which is subtracted.
    """

    brightness: float = 1.0
    dark: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.brightness <= 1.0:
            raise ConfigurationError(
                field="brightness", expected="above 0, at most 1", seen=str(self.brightness)
            )


class LitRig:
    """A rig whose projector is a device of it: connected, armed and let go with its cameras.

    The projector flashes by the cameras' strobe line; a dark exposure is one more trigger, next to the lit
    one, while it is switched off.

    Parameters
    ----------
    rig
        Its cameras.
    projector
        Its light.
    light
        How bright, and whether there are dark exposures; exchange it before `arm`.
    clock
        Monotonic seconds.

    Raises
    ------
    ConfigurationError
        When dark exposures are wanted of a projector that is always lit.
    """

    def __init__(
        self,
        rig: Rig,
        projector: ProjectorDevice,
        light: RigLight | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.name = rig.name
        self.rig = rig
        self.projector = projector
        self.light = light or RigLight()
        self._clock = clock
        if self.light.dark and not projector.can_be_dark:
            raise ConfigurationError(
                field="dark",
                expected="false, for a projector that cannot be switched off",
                seen="true",
                cure="Take no dark exposures, or drive the projector by a driver that switches it",
            )

    @property
    def _plays(self) -> bool:
        """Whether a recording says what is lit and what is dark."""
        return bool(getattr(self.rig, "plays", False))

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """As of `Rig`."""
        return self.rig.cameras

    def connect(self) -> None:
        """Reach projector and cameras.

        Raises
        ------
        SeveralErrors
            What failed of both, together; what did connect is let go again.
        """
        failures: list[TruewheelError] = []
        for reach in (self._connect_projector, self.rig.connect):
            try:
                reach()
            except TruewheelError as error:
                failures.append(error)
        if failures:
            self._closed()
            raise _together(f"rig {self.name}: it did not connect", failures)

    def arm(self) -> None:
        """Arm the cameras, with the projector lit; errors as `Rig.arm`, and ProjectorError."""
        self._lit()
        self.rig.arm()

    def shoot(self, timeout_s: float) -> WheelShot:
        """Take a shot, with its dark exposure where one is wanted.

        Parameters
        ----------
        timeout_s
            Bound of the waiting for the frames of both exposures together, seconds.

        Raises
        ------
        SeveralErrors
            As `Rig.shoot`.
        ProjectorError
            When the projector cannot be switched; it is lit again whatever becomes of the dark exposure.
        """
        began_s = self._clock()
        lit = self.rig.shoot(timeout_s)
        if not self.light.dark or self._plays:
            return lit
        with self._asked("dark"):
            self.projector.dark()
        try:
            dark = self.rig.shoot(max(0.0, timeout_s - (self._clock() - began_s)))
        finally:
            self._lit()
        return replace(lit, dark=dark.heads)

    def shoot_unlit(self, timeout_s: float) -> WheelShot:
        """Take a shot without the projector's light, as of a plate; with it where it cannot be dark.

        Bound and errors are those of `shoot`.
        """
        if not self.projector.can_be_dark:
            return self.rig.shoot(timeout_s)
        with self._asked("dark"):
            self.projector.dark()
        try:
            return self.rig.shoot(timeout_s)
        finally:
            self._lit()

    def state(self) -> ProjectorState:
        """Ask the projector how it is; ProjectorError when it does not answer."""
        with self._asked("state"):
            return self.projector.state()

    def close(self) -> None:
        """Let cameras and projector go, whatever state they are in.

        Raises
        ------
        SeveralErrors
            What failed to close.
        """
        failures = self._closed()
        if failures:
            raise _together(f"rig {self.name}: it did not close", failures)

    def _closed(self) -> list[TruewheelError]:
        failures: list[TruewheelError] = []
        for close in (self._close_projector, self.rig.close):
            try:
                close()
            except TruewheelError as error:
                failures.append(error)
        return failures

    def _connect_projector(self) -> None:
        with self._asked("connect"):
            self.projector.connect()

    def _close_projector(self) -> None:
        with self._asked("close"):
            self.projector.close()

    def _lit(self) -> None:
        with self._asked("light"):
            self.projector.light(self.light.brightness)

    @contextmanager
    def _asked(self, what: str) -> Iterator[None]:
        """Let whatever a foreign driver raises be an error of this projector."""
        try:
            yield
        except TruewheelError:
            raise
        except Exception as error:
            raise driver_failed(self.name, what, error) from error


def _together(message: str, failures: list[TruewheelError]) -> TruewheelError:
    return failures[0] if len(failures) == 1 else SeveralErrors(message, failures)
