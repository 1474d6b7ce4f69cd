"""What interface 3.2 added to the DBC: where the station stands with its master checks.

A DBC of 3.1 has none of it; with such a one a station enforces its checks all the same, and says less of why.
"""

from __future__ import annotations

from collections.abc import Mapping

import can

from alignment.errors import LineError
from station.cycle import ErrorCode
from station.duty import MasterState
from station.line.wire.dbc import LineDatabase, Value
from station.line.wire.master_needs import MASTER_CODES
from station.line.wire.messages import LineMaster
from station.line.wire.numbers import bounded, read_number


def master_frame(database: LineDatabase, master: LineMaster) -> can.Message:
    """One MasterCheck message; more than its signals hold is sent as the most they hold."""
    name = "MasterCheck"
    return database.encode(
        name,
        {
            "State": str(master.state),
            "VehiclesLeft": bounded(database, name, "VehiclesLeft", master.vehicles_left),
            "MinutesLeft": bounded(database, name, "MinutesLeft", master.minutes_left),
            "Doubted": min(master.doubted, int(database.range_of(name, "Doubted")[1])),
        },
    )


def read_master(values: Mapping[str, Value]) -> LineMaster:
    """Where the master checks stand, from the decoded message.

    Raises
    ------
    LineError
        When a word is none of its value table.
    """
    vehicles, minutes = read_number(values["VehiclesLeft"]), read_number(values["MinutesLeft"])
    try:
        return LineMaster(
            MasterState(str(values["State"])),
            None if vehicles is None else int(vehicles),
            None if minutes is None else int(minutes),
            int(values["Doubted"]),
        )
    except ValueError as error:
        raise LineError(f"the master checks of the station are not understood: {error}") from error


def known_word(database: LineDatabase, code: ErrorCode) -> ErrorCode:
    """The error code as this DBC can say it: before 3.2 what is not served is a mode that is not there."""
    return code if database.has_master or code not in MASTER_CODES else known_before_masters()


def known_before_masters() -> ErrorCode:
    """What the codes of 3.2 are said as with an older DBC."""
    return ErrorCode.MODE_NOT_AVAILABLE
