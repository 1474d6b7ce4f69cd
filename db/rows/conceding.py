"""Which vehicles may be released although they are not ok."""

from __future__ import annotations

from sqlalchemy import Connection, select

from alignment.errors import InputError
from db.records import ConcessionRecord, ConcessionWithdrawal, CycleOutcome
from db.rows.reading import CYCLES, key_of, load_records, read_concessions, read_cycles
from db.schema import cycles, vehicles


def refuse_concession(connection: Connection, where: str, record: ConcessionRecord) -> None:
    """Refuse a concession of what cannot be released.

    Raises
    ------
    InputError
        When there is no such cycle, when it did not end in NOK, when a later cycle of the vehicle counts, or
        when one is in force already.
    """
    if load_records(connection, "concession", [key_of(record)]):
        # A call that is made again after its commit was lost changes nothing.
        return

    def refusal(expected: str, seen: str) -> InputError:
        return InputError(choice="cycle", expected=f"{expected} in {where}", seen=seen)

    found = read_cycles(connection, CYCLES.where(cycles.c.uuid == record.cycle))
    if not found:
        raise refusal("a cycle", f"none with UUID {record.cycle}")
    cycle = found[0].record
    if cycle.outcome is not CycleOutcome.NOK:
        raise refusal("a cycle that ended in nok", f"{record.cycle} with the result {cycle.outcome}")
    assert cycle.vehicle is not None
    newest = (
        select(cycles.c.uuid)
        .join(vehicles, vehicles.c.id == cycles.c.vehicle_id)
        .where(vehicles.c.vin == cycle.vehicle.vin)
        .order_by(cycles.c.id.desc())
        .limit(1)
    )
    last = connection.execute(newest).scalar_one()
    if last != record.cycle:
        # As it was left counts, not as it was found.
        raise refusal("the newest cycle of its vehicle", f"{record.cycle}, and {last} after it")
    for stored in read_concessions(connection, [record.cycle]):
        if stored.in_force:
            granted = f"by {stored.record.person} on {stored.record.utc:%Y-%m-%d}: {stored.record.reason}"
            raise refusal("a cycle without a concession", f"{record.cycle} with one {granted}")


def refuse_withdrawal(connection: Connection, where: str, record: ConcessionWithdrawal) -> None:
    """Refuse to take back what nobody granted, or what was taken back by another record.

    Raises
    ------
    InputError
        Then.
    """
    seen = None
    before = load_records(connection, "withdrawal", [key_of(record)]).get(key_of(record))
    if before is not None and before != record:
        seen = f"one withdrawn by {before.person} on {before.utc:%Y-%m-%d}: {before.reason}"
    elif not load_records(connection, "concession", [record.concession.hex]):
        seen = f"none with UUID {record.concession}"
    if seen is not None:
        raise InputError(choice="concession", expected=f"a concession in force in {where}", seen=seen)
