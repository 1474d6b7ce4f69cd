"""Times as a person types them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from alignment.errors import ConfigurationError

_SPANS = {"h": timedelta(hours=1), "d": timedelta(days=1), "w": timedelta(weeks=1)}


def read_time(choice: str, text: str | None, now: datetime | None = None) -> datetime | None:
    """An aware time: ISO 8601, UTC where it names no zone, or a span before now: ``8h``, ``7d``, ``4w``.

    Parameters
    ----------
    choice
        What was chosen with it, for the error: from, until.
    text
        None gives None.
    now
        Aware; the clock's time without.

    Raises
    ------
    ConfigurationError
        For anything else.
    """
    if text is None:
        return None
    number, span = text[:-1], _SPANS.get(text[-1:])
    try:
        if span is not None and number.isascii() and number.isdigit():
            return (now or datetime.now(UTC)) - int(number) * span
        time = datetime.fromisoformat(text)
        return time.replace(tzinfo=UTC) if time.utcoffset() is None else time.astimezone(UTC)
    except (ValueError, OverflowError):
        raise ConfigurationError(
            choice=choice,
            expected="a time such as 2026-11-22 or 2026-11-22T06:00+01:00, or a span before now such as 7d",
            seen=ascii(text[:60]),
        ) from None
