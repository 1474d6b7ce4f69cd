"""Several sentences are told as one text, each with its own mark: no full stop before another mark."""

from __future__ import annotations

import pytest

from alignment.errors import (
    CameraError,
    ConfigurationError,
    Deed,
    Remedy,
    SeveralErrors,
    StoreError,
    TruewheelError,
    together,
)

CURE = "Check the cable."


@pytest.mark.parametrize(
    "error",
    [
        SeveralErrors("2 parts failed", [CameraError("left", "is away", CURE), CameraError("right", "too.")]),
        ConfigurationError(expected="this", cure=CURE, remedy=Remedy(Deed.MIGRATE, "sqlite:///a.db")),
        ConfigurationError(expected="this", seen="that.", cure=CURE),
        StoreError("the database is away.", Remedy(Deed.CHECK_DATABASE, then="Then restore the last copy.")),
        CameraError("left", "is away.", CURE),
    ],
    ids=lambda error: type(error).__name__,
)
def test_no_full_stop_is_followed_by_another_mark(error: TruewheelError) -> None:
    """A station whose cameras were away said ``Check its cable.; camera right: …``."""
    text = str(error)
    assert ".;" not in text
    assert ".." not in text
    assert " ," not in text


def test_texts_together() -> None:
    assert together(["a.", "b", "c."]) == "a; b; c."
    assert together(["a.", "b"], ". ") == "a. b"
    assert together([]) == ""
