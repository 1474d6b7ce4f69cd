"""What was stored beside what is found now."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from sensors.formats import ArchivedResult
from station.replay.values import Cause, Difference
from station.store import CODE

WORDS = ("outcome", "reason_code", "method", "degraded")
"""Fields of a result that are no numbers; `reason_text` is for people and not compared."""
ANGLES = ("camber", "toe", "run_out")
"""What counts of a result when small differences do not."""
NUMBERS = (
    *ANGLES, "camber_u", "toe_u", "points_used", "residual_rms_mm", "load_mm", "row_px", "knock_evidence",
    "camber_unseen", "toe_unseen", "run_out_u", "high_spot", "high_spot_u", "covered_turn", "turned",
    "wander", "shots_used",
)  # fmt: skip


def differences(
    stored: Mapping[str, Any], found: ArchivedResult, within: float, loose: Mapping[str, float]
) -> tuple[Difference, ...]:
    """Return every value that is another one.

    Parameters
    ----------
    stored
        Fields of a result; one that is not among them is not compared.
    found
        Now.
    within
        As in `Choices`.
    loose
        By name how far apart a number may be all the same.
    """
    return tuple(_differences(stored, found.model_dump(mode="json"), within, loose))


def _differences(
    stored: Mapping[str, Any], found: Mapping[str, Any], within: float, loose: Mapping[str, float]
) -> Iterator[Difference]:
    for name in WORDS:
        if name in stored and stored[name] != found[name]:
            yield Difference(name, stored[name], found[name])
    for name in NUMBERS if within == 0.0 else ANGLES:
        if name not in stored:
            continue
        one, other = stored[name], found[name]
        apart = max(within, loose.get(name, 0.0))
        if one is None or other is None:
            same = one is None and other is None
        else:
            same = one == other or abs(one - other) <= apart
        if not same:
            yield Difference(name, one, other)


def other_software(
    version: str, environment: Mapping[str, str] | None, now_version: str, now: Mapping[str, str]
) -> str | None:
    """Say in words what of program, libraries and computer is another one; None when nothing is known to be.

    Parameters
    ----------
    version, environment
        That measured then; None where the archive does not say.
    now_version, now
        That measures now.
    """
    said = [] if version == now_version else [f"truewheel {version} → {now_version}"]
    for name in sorted({*now, *environment} if environment else ()):
        before, after = (environment or {}).get(name), now.get(name)
        # Nothing is said of what either of the two does not tell.
        if before is None or after is None or before == after:
            continue
        said.append("the program's mathematics" if name == CODE else f"{name} {before} → {after}")
    return ", ".join(said) or None


def cause(kind: Cause, what: str | None = None) -> str:
    """Return a cause in words."""
    return str(kind) if what is None else f"{kind}: {what}"
