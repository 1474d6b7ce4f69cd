"""What every error code of the line means and what cures it; the documents and ErrorDetail come from here."""

from __future__ import annotations

from dataclasses import dataclass

from station.cycle import ErrorCode
from station.line.wire.dbc_needs import INTERFACE_MAJOR, UNSTATED_MAJOR
from station.line.wire.messages import Part


@dataclass(frozen=True)
class Meaning:
    """Part of the station that a code is about, its cause, and its cure, both sentences."""

    part: Part
    cause: str
    cure: str


def _reserved(part: Part, what: str) -> Meaning:
    return Meaning(part, f"Reserved, no station sends it yet. {what}", "Nothing to do.")


MEANINGS: dict[ErrorCode, Meaning] = {
    ErrorCode.NONE: Meaning(Part.NONE, "Nothing is wrong.", "Nothing to do."),
    ErrorCode.VIN_INCOMPLETE: Meaning(
        Part.LINE,
        "Of Vin1 to Vin3 at least one did not arrive with this sequence number within two seconds before the "
        "command, with good CRC and counter.",
        "Send all three again; the standing command is looked at again with each frame.",
    ),
    ErrorCode.VIN_INVALID: Meaning(
        Part.LINE,
        "The VIN holds a character other than digits and capital letters without I, O and Q.",
        "Correct the VIN and give the command a new number.",
    ),
    ErrorCode.NO_WHEELS: Meaning(
        Part.LINE, "The start marks no wheel.", "Set the bit of at least one wheel."
    ),
    ErrorCode.UNKNOWN_COMMAND: Meaning(
        Part.LINE,
        "The code of the command is none of the value table, or step on a line before interface 3.1.",
        "Send a code of the value table.",
    ),
    ErrorCode.BUSY: Meaning(
        Part.CYCLE, "Another start is in hand.", "Wait until Status shows Ready, or abort the other one."
    ),
    ErrorCode.NOT_ACKNOWLEDGED: Meaning(
        Part.CYCLE,
        "Results of the start before wait for their acknowledgement.",
        "Read and acknowledge them, or reset.",
    ),
    ErrorCode.SEQUENCE_USED: Meaning(
        Part.CYCLE, "The start before had this number.", "Give every start another number."
    ),
    ErrorCode.WRONG_SEQUENCE: Meaning(
        Part.CYCLE,
        "The command names a start that is not in hand, or a start has the number 0.",
        "Repeat the number of the start, which Status shows as Sequence; number starts from 1 to 255.",
    ),
    ErrorCode.NOTHING_TO_ACKNOWLEDGE: Meaning(
        Part.CYCLE, "The results are not there yet.", "Acknowledge when Status shows ResultValid."
    ),
    ErrorCode.RESET_REQUIRED: Meaning(
        Part.CYCLE, "The station is at fault.", "Repair what the fault says, then send reset."
    ),
    ErrorCode.MASTER_CHECK_OVERDUE: Meaning(
        Part.CALIBRATION,
        "A check with a master is due, so no vehicle is measured; a start in the mode master_check is taken.",
        "Check every rig with its master wheel or a master vehicle; the log says which are due and why.",
    ),
    ErrorCode.MASTER_CHECK_FAILED: Meaning(
        Part.CALIBRATION,
        "The last check with a master was out of its limits, so no vehicle is measured; a start in the mode "
        "master_check is taken. The vehicles since the last good check are in doubt.",
        "Look at the master and its limits, check again, and calibrate anew where the rig has moved.",
    ),
    ErrorCode.UNKNOWN_VEHICLE_TYPE: Meaning(
        Part.CONFIGURATION,
        "No vehicle type has this number.",
        "Add a file of the type to the station's configuration, or correct the number.",
    ),
    ErrorCode.WHEEL_NOT_AVAILABLE: Meaning(
        Part.CONFIGURATION,
        "A marked wheel has no rig, or its axle no limits in the vehicle type.",
        "Mark other wheels, or complete the configuration.",
    ),
    ErrorCode.NOTHING_TO_STOP: Meaning(
        Part.CYCLE,
        "The station neither adjusts nor is prepared.",
        "Stop only while Status shows the state adjusting; abort ends any other cycle.",
    ),
    ErrorCode.START_STALE: Meaning(
        Part.LINE,
        "The start stood on the bus already when the station started or the communication came back.",
        "Go back to none, look whether the vehicle still stands there, and start it with a new number.",
    ),
    ErrorCode.RESETTING: Meaning(
        Part.CYCLE, "The station is still carrying out a reset.", "Wait until Status shows Ready or Fault."
    ),
    ErrorCode.MODE_NOT_AVAILABLE: Meaning(
        Part.CONFIGURATION,
        "The mode is none of the value table, or this station is not set up for it.",
        "Choose another mode; calibrate needs a folder for its images in the configuration, sweep a vehicle "
        "type that says how its steering is swept.",
    ),
    ErrorCode.WRONG_INTERFACE: Meaning(
        Part.LINE,
        f"The controller speaks another major version of the interface than {INTERFACE_MAJOR}: "
        f"Command.InterfaceMajor says so, where 0 means {UNSTATED_MAJOR}.",
        "Bring the controller's program to the station's interface; StationInfo says which it is.",
    ),
    ErrorCode.NOTHING_TO_STEP: Meaning(
        Part.CYCLE,
        "No sweep of this start waits for a step.",
        "Send step only while Status shows the state turning, with the position that SweepProgress wants.",
    ),
    ErrorCode.STEP_INCOMPLETE: Meaning(
        Part.LINE,
        "No SweepStep arrived with this sequence number and a position within two seconds before the "
        "command, with good CRC and counter.",
        "Send it again; the standing command is looked at again with each frame.",
    ),
    ErrorCode.CAMERA_FAULT: Meaning(
        Part.CAMERAS,
        "A camera was lost, or delivered no image in time.",
        "Check its cable and power; the record names it. Then reset.",
    ),
    ErrorCode.CALIBRATION_FAULT: Meaning(
        Part.CALIBRATION,
        "A rig's calibration is out of date, of other cameras, or missing.",
        "Calibrate the rig, then reset.",
    ),
    ErrorCode.MEASUREMENT_REFUSED: Meaning(
        Part.MEASUREMENT,
        "The images of a wheel could not be measured; the record says why.",
        "Clean tyre and windows, check the vehicle's position, and start again with a new number.",
    ),
    ErrorCode.STORE_FAULT: Meaning(
        Part.STORE,
        "The result could not be stored, so nothing is judged.",
        "Check the database and its disk, then reset.",
    ),
    ErrorCode.CYCLE_TIMEOUT: Meaning(
        Part.CYCLE,
        "A wheel was not measured within the configured time.",
        "Check the load of the computer and the cameras, then reset.",
    ),
    ErrorCode.CONFIGURATION_FAULT: Meaning(
        Part.CONFIGURATION, "The configuration cannot be used.", "Correct it and start the program again."
    ),
    ErrorCode.INTERNAL_FAULT: Meaning(
        Part.CYCLE,
        "A defect of the program.",
        "Keep the log and report it; reset, or start the program again.",
    ),
    ErrorCode.LINE_FAULT: Meaning(
        Part.LINE, "Results could not be put on the bus.", "Check the station's log, then reset."
    ),
    ErrorCode.STARTING: Meaning(
        Part.CYCLE,
        "The station's program is starting: it loads what a measurement needs and, on a new computer, "
        "compiles it, which takes a minute or more.",
        "Wait until Status shows Ready; compiling once at the installation makes it short.",
    ),
    ErrorCode.COMMUNICATION_LOST: Meaning(
        Part.LINE,
        "No good Command frame arrived within its timeout.",
        "Check cable and controller. The station takes no start until frames come again.",
    ),
    ErrorCode.ADJUST_TIMEOUT: Meaning(
        Part.CYCLE,
        "Adjusting was not stopped within the configured time; the cycle was aborted.",
        "Start again with a new number.",
    ),
    ErrorCode.SWEEP_FAULT: Meaning(
        Part.CYCLE,
        "A sweep of the steering brought no steering axes: it was stopped, its step did not come in time, a "
        "position could not be measured, or what was measured is no steering axis; the record says which.",
        "Look at the record, set the wheels straight ahead, and start again with a new number.",
    ),
    ErrorCode.GUIDANCE_FAULT: _reserved(Part.CYCLE, "Guidance of the operator that failed."),
    ErrorCode.STEERING_FAULT: Meaning(
        Part.CYCLE,
        "The steering wheel's angle was lost, stood still while steps were claimed, jumped, or is not the "
        "one that was wanted; the record says which.",
        "Check the sensor and what turns the steering, and start again with a new number.",
    ),
    ErrorCode.LOCATE_FAULT: _reserved(Part.MEASUREMENT, "Places on the vehicle that were not found."),
}
"""By code; every code has its row."""
