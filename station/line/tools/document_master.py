"""The part of the line interface's description about master checks, drawn from the table of the duty."""

from __future__ import annotations

from station.duty import DUTY, EVENTS_SAID, STATES_SAID, DoubtDeed, DutyEvent, DutyRule, MasterState
from station.line.tools.document_steering import MakesTable
from station.line.wire import known_before_masters

_TOLD = """
## Master checks

All of this came with interface 3.2. A station whose configuration asks for no master checks shows
*not_required* and is as one of 3.1; a controller of 3.0 or 3.1 may leave `MasterCheck` unread.

A station that asks for them says in `MasterCheck` where it stands, and how many vehicles and minutes are
left. In the states overdue and failed it measures no vehicle: `Status.Ready` is no, `Status.ErrorCode` is
`master_check_overdue` or `master_check_failed`, and a start or a preparation in any mode but master_check
and calibrate is refused with that code, although `Status.Handshake` shows ready. A start in the mode
master_check is taken there: a controller that serves them starts one when `Status.Handshake` is ready,
whatever `Status.Ready` says. A good check of every rig that owes one makes the station ready; a reset
does not.

`Doubted` counts the vehicles that were measured since the last good check of a rig whose check failed, and
that neither a good check nor a person has answered for. Their verdicts stay as they were told.

With a DBC before 3.2 the station enforces its checks all the same. It says `{before}` in place of the two
codes, and sends no `MasterCheck`.

"""
_EVENTS = """

The station is where the worst of its rigs is. What every event does to a rig: **→** leads to a state,
*counted* to good, due_soon or overdue by what is left, a dash changes nothing.

"""
_MEANS = """

What becomes of the vehicles that the rig measured since its last good check:

"""
_HAPPENS = """

When an event happens:

"""


def master_text(table: MakesTable) -> str:
    """The part, Markdown; `table` makes one of a head and rows."""
    states = [[f"**{state}**", STATES_SAID[state]] for state in MasterState]
    events = [[event, *(_cell(DUTY[state][event]) for state in MasterState)] for event in DutyEvent]
    deeds = [[event, *(_deed(DUTY[state][event]) for state in MasterState)] for event in DutyEvent]
    return (
        _TOLD.format(before=known_before_masters())
        + table(("state", "means"), states)
        + _EVENTS
        + table(("event", *MasterState), events)
        + _MEANS
        + table(("event", *MasterState), [row for row in deeds if set(row[1:]) != {"–"}])
        + _HAPPENS
        + table(("event", "when"), [[event, EVENTS_SAID[event]] for event in DutyEvent])
    )


def _cell(rule: DutyRule) -> str:
    if rule.counted:
        return "*counted*"
    return "–" if rule.target is None else f"→ {rule.target}"


def _deed(rule: DutyRule) -> str:
    return "–" if rule.deed is DoubtDeed.NOTHING else str(rule.deed)
