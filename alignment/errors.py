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
    ├── ProjectorError(RuntimeError)        the light of one rig, named
    │   ├── ProjectorConnectionError(ConnectionError)
    │   └── ProjectorTimeoutError(TimeoutError)
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
Each error says where, what was expected, what was seen, and the cure. It speaks of choices and remedies in
plain words; a surface that has its own (options of a command, inputs of a screen) tells them in `Words`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from os import PathLike, fspath


class Deed(StrEnum):
    """What a person can do about an error, and each surface has its own way to; in plain words."""

    FORCE = "To do it all the same, force it and give a reason, which is recorded"
    NAME_CONFIGURATION = "Name one"
    BEGIN_CONFIGURATION = "Name one, or write one to start from"
    SAY_IMAGE_SIZE = "Say the size of the images"
    SAY_UNIT = "Say that they are in {of}"
    MIGRATE = "Migrate the database {of}"
    MAKE_DATABASE = "Make the database {of} first"
    CHECK_DATABASE = "Check the whole database"
    REBUILD_SUMS = "Make the sums anew of the results"
    LIST_ZEROS = "See the list of the zero measurements"
    LIST_STUDIES = "See the list of the studies"
    LIST_DRIVERS = "See the list of the drivers that are installed"
    WARM_UP = "Compile the functions, then try again"


@dataclass(frozen=True)
class Remedy:
    """A deed, what it is done to (the URL of a database), and what else there is to do, a sentence."""

    deed: Deed
    of: str = ""
    then: str = ""

    def __str__(self) -> str:
        return self.told(str(self.deed))

    def told(self, deed: str) -> str:
        """Return the sentences of the remedy with the deed in other words; ``{of}`` is what it is done to."""
        return together((part for part in (deed.replace("{of}", self.of), self.then) if part), ". ")


@dataclass(frozen=True)
class Words:
    """How a surface names a choice of the person who asked, and tells a remedy."""

    choice: Callable[[str], str] = str
    remedy: Callable[[Remedy], str] = str


PLAIN = Words()
"""The words of a surface without any of its own."""


class TruewheelError(Exception):
    """Base class of all errors of the product; `str(error)` is one sentence for a person."""

    def told(self, words: Words) -> str:
        """Return the sentence in the words of a surface."""
        return str(self)


def together(texts: Iterable[str], between: str = "; ") -> str:
    """Return several texts as one, such as the failures of one step; no full stop is before another mark."""
    *before, last = list(texts) or [""]
    return between.join([*(text.removesuffix(".") for text in before), last])


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
    choice
        Instead of a field: what the person who asked chose, in plain words (``study``, ``limits from``),
        several with commas between them. A command shows its option, a screen what stands beside the input.
    cure
        What to do, a whole sentence.
    remedy
        What to do that each surface has its own way to; told after the cure.
    """

    def __init__(
        self,
        *,
        expected: str,
        seen: str | None = None,
        file: str | PathLike[str] | None = None,
        field: str | None = None,
        choice: str | None = None,
        cure: str | None = None,
        remedy: Remedy | None = None,
    ) -> None:
        self.expected = expected
        self.seen = seen
        self.file = None if file is None else fspath(file)
        self.field = choice if field is None else field
        self.choice = choice
        self.cure = cure
        self.remedy = remedy
        super().__init__(self.told(PLAIN))

    def told(self, words: Words) -> str:
        """Return the sentence in the words of a surface."""
        field = self.field
        if self.choice is not None:
            field = ", ".join(words.choice(name.strip()) for name in self.choice.split(","))
        where = ", ".join(part for part in (self.file, field and f"field '{field}'") if part)
        text = f"expected {self.expected}"
        if self.seen is not None:
            text += f", found {self.seen}"
        if where:
            text = f"{where}: {text}"
        parts = (text, self.cure, self.remedy and words.remedy(self.remedy))
        return together((part for part in parts if part), ". ")


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
        super().__init__(self._text(f"camera {camera}"))

    def stands_at(self, place: str) -> None:
        """Name the camera's place too: ``wheel front left, head 2, right camera, serial 40123456``."""
        self.args = (self._text(f"camera {self.camera} ({place})"),)

    def _text(self, named: str) -> str:
        return together((f"{named}: {self.problem}", *([self.cure] if self.cure else [])), ". ")


class CameraConnectionError(CameraError, ConnectionError):
    """A camera that cannot be reached or was lost."""


class CameraTimeoutError(CameraError, TimeoutError):
    """No frame within the bounded time."""


class ProjectorError(TruewheelError, RuntimeError):
    """A projector failed; the message names the rig that it lights.

    Parameters
    ----------
    rig
        Name of the rig.
    problem
        What happened, what was expected, the last value seen.
    cure
        What to do, a whole sentence.
    """

    def __init__(self, rig: str, problem: str, cure: str | None = None) -> None:
        self.rig = rig
        self.problem = problem
        self.cure = cure
        super().__init__(together((f"projector of {rig}: {problem}", *([cure] if cure else [])), ". "))


class ProjectorConnectionError(ProjectorError, ConnectionError):
    """It cannot be reached, or its driver does not come back."""


class ProjectorTimeoutError(ProjectorError, TimeoutError):
    """No answer within the bounded time."""


class LineError(TruewheelError, RuntimeError):
    """The bus to the PLC failed."""


class LineConnectionError(LineError, ConnectionError):
    """The bus cannot be opened or was lost."""


class LineTimeoutError(LineError, TimeoutError):
    """No answer from the other side within the bounded time."""


class _RemediedError(TruewheelError, RuntimeError):
    """A fault told in one text, and what a person can do about it."""

    def __init__(self, problem: str, remedy: Remedy | None = None) -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(self.told(PLAIN))

    def told(self, words: Words) -> str:
        """Return the sentence in the words of a surface."""
        return (
            self.problem if self.remedy is None else together((self.problem, words.remedy(self.remedy)), ". ")
        )


class StoreError(_RemediedError):
    """The result database refused or failed."""


class StoreUnavailableError(StoreError, ConnectionError):
    """The result database cannot be opened or was lost."""


class StoreDamagedError(StoreError, ValueError):
    """The result database is no database any more, or holds what no program can have stored."""


class StoreSchemaError(StoreError):
    """The database has another schema revision than this program; the message holds the cure."""


class WarmUpError(_RemediedError):
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
        return self.told(PLAIN)

    def told(self, words: Words) -> str:
        """Return the sentences of all in the words of a surface."""
        parts = [
            error.told(words) if isinstance(error, TruewheelError) else str(error)
            for error in self.exceptions
        ]
        return together([self.message, *parts])
