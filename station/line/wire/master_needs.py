"""What the line needs of a DBC since interface 3.2: the master checks of the station."""

from __future__ import annotations

from dataclasses import replace

from station.cycle import ErrorCode
from station.duty import MasterState
from station.line.wire.dbc_needs import INVALID, Need, Needs

MASTER_SINCE = (3, 2)
"""Version of the interface that has all this."""
MASTER_CODES = frozenset({ErrorCode.MASTER_CHECK_OVERDUE, ErrorCode.MASTER_CHECK_FAILED})
_LEFT = Need(highest=65_000.0, words=(INVALID,))
MASTER_FIXED: Needs = {
    "MasterCheck": {
        "State": Need(words=tuple(MasterState)),
        "VehiclesLeft": _LEFT,
        "MinutesLeft": _LEFT,
        "Doubted": Need(highest=65_535.0),
    }
}


def without_master(needs: Needs) -> Needs:
    """What of these needs a DBC of an earlier interface has too: without the words that came with 3.2."""
    return {message: {name: _before(need) for name, need in of.items()} for message, of in needs.items()}


def _before(need: Need) -> Need:
    if not set(need.words) & MASTER_CODES:
        return need
    return replace(need, words=tuple(word for word in need.words if word not in MASTER_CODES))
