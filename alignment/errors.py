"""Every error Truewheel raises, one tree.

::

    TruewheelError
    ├── InputError(ValueError)              a file or value that a person can correct
    │   ├── FormatError                     a recorded shot, plate session, calibration, image
    │   ├── ConfigurationError              a TOML, a DBC, a vehicle type
    │   └── DegenerateInputError            arrays from which the asked value cannot be computed
    ├── CameraError(RuntimeError)           one camera, named
    │   ├── CameraConnectionError(ConnectionError)
    │   └── CameraTimeoutError(TimeoutError)
    ├── LineError(RuntimeError)             the bus to the PLC
    │   ├── LineConnectionError(ConnectionError)
    │   └── LineTimeoutError(TimeoutError)
    ├── StoreError(RuntimeError)            the result database
    │   ├── StoreUnavailableError(ConnectionError)
    │   ├── StoreDamagedError               a database that holds what no program stored
    │   └── StoreSchemaError                a database of another schema revision
    ├── WarmUpError(RuntimeError)           a compiled function that is not there
    └── SeveralErrors(ExceptionGroup)       all failures of one step, reported together

A measurement that failed is not an error: it is a `Refusal` value (see `alignment.values`).
Each error says where, what was expected, what was seen, and the cure.
"""

from __future__ import annotations

from os import PathLike, fspath


class TruewheelError(Exception):
    """Base class of all errors of the product; `str(error)` is one sentence for a person."""


def told(error: BaseException, longest: int = 300) -> str:
    """Return what an error of somebody else's code says, as a part of one sentence: its kind and its text."""
    text = " ".join(str(error).split())
    text = text if len(text) <= longest else text[: longest - 1] + "…"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class InputError(TruewheelError, ValueError):
    """Bad input that a person can correct.

    Parameters
    ----------
    expected
        What should have been there, as the rest of "expected …".
    seen
        What was there instead, as text; omitted from the message when None.
    file
        The file at fault, when there is one.
    field
        The field in it, in dotted form (``heads[1].left.fx``), when there is one.
    cure
        What to do, a whole sentence.
    """

    def __init__(
        self,
        *,
        expected: str,
        seen: str | None = None,
        file: str | PathLike[str] | None = None,
        field: str | None = None,
        cure: str | None = None,
    ) -> None:
        self.expected = expected
        self.seen = seen
        self.file = None if file is None else fspath(file)
        self.field = field
        self.cure = cure
        where = ", ".join(part for part in (self.file, field and f"field '{field}'") if part)
        text = f"expected {expected}"
        if seen is not None:
            text += f", found {seen}"
        if where:
            text = f"{where}: {text}"
        if cure:
            text += f". {cure}"
        super().__init__(text)


class FormatError(InputError):
    """A recorded shot, plate session, calibration or image that cannot be read as what it claims to be."""


class ConfigurationError(InputError):
    """A station, vehicle-type or line description (TOML, DBC) with a wrong or missing field."""


class DegenerateInputError(InputError):
    """Arrays from which the asked value cannot be computed, such as three collinear points for a plane."""


class CameraError(TruewheelError, RuntimeError):
    """A camera failed; the message starts with its name.

    Parameters
    ----------
    camera
        Name of the camera, such as ``front_left/head_1/left``.
    problem
        What happened, what was expected, the last value seen.
    cure
        What to do, a whole sentence.
    """

    def __init__(self, camera: str, problem: str, cure: str | None = None) -> None:
        self.camera = camera
        self.problem = problem
        self.cure = cure
        super().__init__(f"camera {camera}: {problem}" + (f". {cure}" if cure else ""))


class CameraConnectionError(CameraError, ConnectionError):
    """A camera that cannot be reached or was lost."""


class CameraTimeoutError(CameraError, TimeoutError):
    """No frame within the bounded time."""


class LineError(TruewheelError, RuntimeError):
    """The bus to the PLC failed."""


class LineConnectionError(LineError, ConnectionError):
    """The bus cannot be opened or was lost."""


class LineTimeoutError(LineError, TimeoutError):
    """No answer from the other side within the bounded time."""


class StoreError(TruewheelError, RuntimeError):
    """The result database refused or failed."""


class StoreUnavailableError(StoreError, ConnectionError):
    """The result database cannot be opened or was lost."""


class StoreDamagedError(StoreError, ValueError):
    """The result database is no database any more, or holds what no program can have stored."""


class StoreSchemaError(StoreError):
    """The database has another schema revision than this program; the message holds the cure."""


class WarmUpError(TruewheelError, RuntimeError):
    """What a measurement needs could not be compiled or loaded.

    Example: ``the function alignment.imaging.ridges.scan_rows was not compiled: …``.
    """


class SeveralErrors(TruewheelError, ExceptionGroup):  # noqa: N818  (the name reads as the group it is)
    """All failures of one step (six cameras, four rigs), reported together.

    Raise as ``SeveralErrors("2 of 6 cameras did not connect", [error, error])``.
    """

    def derive(self, excs):  # type: ignore[no-untyped-def]
        """Build a group of the same class from some of the members (`ExceptionGroup` protocol)."""
        return SeveralErrors(self.message, excs)

    def __str__(self) -> str:
        return "; ".join([self.message, *(str(error) for error in self.exceptions)])
