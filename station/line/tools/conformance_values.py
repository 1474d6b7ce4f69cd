"""Points about what a station tells beside its verdicts: interface, axes of wheels, vehicle, ages."""

from __future__ import annotations

from alignment.counting import listed
from station.cycle import GEOMETRY_ANGLES, AxisKind, ErrorCode, LiveState, Mode, QuantityState
from station.duty import MasterState
from station.line.tools.trial import Trial
from station.line.wire import UNSTATED_MAJOR, Answer, CommandCode

C, E = CommandCode, ErrorCode
_LONGEST_AGE_S = 10.0


def older_controller(trial: Trial) -> None:
    """Every command of a controller that states no interface, as those of interface 2, is refused."""
    spoken, trial.plc.interface = trial.plc.interface, 0
    try:
        for code in (C.PREPARE, C.START):
            sequence = trial.plc.number()
            trial.plc.give(code, trial.order(), sequence)
            trial.refused(code, sequence, E.WRONG_INTERFACE)
        for code in (C.STOP, C.ABORT, C.ACKNOWLEDGE, C.RESET):
            sequence = trial.plc.number()
            trial.plc.command(code, sequence)
            trial.refused(code, sequence, E.WRONG_INTERFACE)
    finally:
        trial.plc.interface = spoken
    trial.status(f"ready after commands of interface {UNSTATED_MAJOR}", lambda s: s.ready)


def mode_of_no_station(trial: Trial) -> None:
    """A mode that the station has not is refused; it may be one that is reserved."""
    sequence = trial.plc.number()
    trial.plc.give(C.START, trial.order(Mode.LOCATE), sequence)
    found = trial.plc.answer_to(C.START, sequence)
    if found.answer is Answer.ACCEPTED:
        # A later station may serve it.
        trial.plc.withdraw()
        trial.plc.reset()
        return
    trial.refused(C.START, sequence, E.MODE_NOT_AVAILABLE)


def kind_of_wheels(trial: Trial) -> None:
    """A judged wheel says what its angles are those of, and a run-out only beside a spin axis."""
    result = trial.plc.run(trial.order())
    for wheel in result.wheels:
        known = wheel.kind is not AxisKind.NONE
        trial.expect(
            f"WheelAxis of {wheel.wheel} with a kind where it was judged, and none elsewhere, found "
            f"'{wheel.kind}' beside '{wheel.outcome}'",
            known == wheel.outcome.judged,
        )


def geometry_of_the_vehicle(trial: Trial) -> None:
    """What angles refer to is told with the results, and lengths only between points that are told."""
    result = trial.plc.run(trial.order())
    geometry = result.vehicle.geometry
    judged = any(wheel.outcome.judged for wheel in result.wheels)
    trial.expect(
        f"VehicleReference with stand or vehicle where wheels were judged, found {geometry.reference}",
        (geometry.reference is not None) == judged,
    )
    measured = [q.name for q in geometry.quantities if q.state.measured and q.name not in GEOMETRY_ANGLES]
    trial.expect(
        f"VehicleReference that says between what lengths were measured, found {geometry.between} beside "
        f"{', '.join(measured) or 'no length'}",
        (geometry.between is not None) == bool(measured),
    )
    missed = [q.name for q in geometry.quantities if q.state is QuantityState.NOK]
    trial.expect(
        f"no vehicle that is ok with {', '.join(missed) or 'a quantity'} out of limits",
        not (missed and result.vehicle.outcome == "ok"),
    )


def live_ages(trial: Trial) -> None:
    """Live angles come with the age of the same shot, which is that of images just taken."""
    sequence, _ = trial.plc.begin(trial.order(Mode.ADJUST))
    view = trial.plc.view

    def aged() -> bool:
        ages = view.live_ages
        return any(
            angles.state in (LiveState.INSIDE, LiveState.OUTSIDE)
            and wheel in ages
            and ages[wheel].shot == angles.shot
            for wheel, angles in view.live.items()
        )

    came = view.wait_until(trial.vehicles.patience_s, aged)
    ages = view.live_ages
    trial.plc.abort(sequence)
    trial.end(sequence)
    trial.expect(f"LiveAge with the number of its LiveAngles, found those of {len(ages)} wheels", came)
    known = [age.age_s for age in ages.values() if age.age_s is not None]
    trial.expect(
        f"ages of 0 to {_LONGEST_AGE_S:g} s, found {', '.join(f'{age:g} s' for age in known) or 'none'}",
        bool(known) and all(0.0 <= age <= _LONGEST_AGE_S for age in known),
    )


def masters_agree(trial: Trial) -> None:
    """MasterCheck comes at its cycle time, and a station that is ready owes no check."""
    if not trial.database.has_master:
        return
    view = trial.plc.view
    came = view.wait_until(trial.vehicles.patience_s, lambda: view.master is not None)
    master = view.master
    trial.expect("MasterCheck, found none", came and master is not None)
    assert master is not None

    def agree() -> bool:
        status, shown = view.status, view.master
        return status is not None and shown is not None and (not status.ready or shown.state.ready)

    found = view.wait_until(trial.vehicles.patience_s, agree)
    trial.expect(f"no master check owed while Status shows Ready, found {master.state}", found)
    left = [each for each in (master.vehicles_left, master.minutes_left) if each is not None]
    trial.expect(
        f"no vehicles and minutes left where no check is required, found {listed(left)}",
        master.state is not MasterState.NOT_REQUIRED or not left,
    )
