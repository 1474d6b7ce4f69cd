"""The prose of the line interface's description; `station.line.tools.document` puts it together."""

HEAD = """
# The line interface

How a PLC and a Truewheel station talk over CAN. This page is written by `truewheel line document` from
`configs/line.dbc` and the program's own tables, and a test asserts that it is current: change those, not
this.

Interface version {major}.{minor}; the station says it in `StationInfo`, the controller in `Command`. The
station refuses every command of a controller of another major version with `wrong_interface`. A minor version
only adds. CAN 2.0, 500 kbit/s unless configured otherwise, standard identifiers.
"""

FOR_PLC_PROGRAMMERS = """
## For PLC programmers

1. **Send `Command` every 100 ms, always**, with code none while there is nothing to do, and at once when it
   changes. It is your sign of life. `InterfaceMajor` in it is {major}, always. Send `Vin1` to `Vin3` with
   zeros every second between vehicles.
2. **Power up**: wait until `Status` comes and `CommandAnswer.LinkUp` is yes, and as long as
   `Status.Handshake` is starting: on a new computer the station compiles for a minute or more, sends
   everything in time and refuses every command with `starting`. If `Status.ResultValid` is yes, the station
   holds results that you have not acknowledged: take them over (6) before anything else. If `Status.Busy` is
   yes, wait for them. If `Status.Fault` is yes, have repaired what `ErrorCode` says, then send reset with a
   new number. Otherwise `Ready` comes by itself.
3. **Start**: when `Ready` is yes, take the next number, send the three VIN frames with it, and put
   `Command` start with number, type, wheels and mode on the bus. Leave all four there, repeated every 100
   ms, until `CommandAnswer` shows this code and number. The next number is one more than `Status.Sequence`,
   1 after 255; if `CommandAnswer.Sequence` shows that one, which a refused start leaves there, take the one
   after it. So you need not keep a number over your own restart; where `Status.Sequence` is 0, the station
   restarted and any number but 0 is right.
4. **Read the answer**: accepted, go back to none; refused, `ErrorCode` says why and nothing has happened.
   Only `vin_incomplete` passes while a start stands, and `starting` while a reset stands; after any other
   refusal go back to none and give the next attempt a new number. The measuring cycle can still refuse a
   start that was accepted, for an unknown vehicle type for one: the answer changes to refused then.
5. **Wait** for `ResultValid` with your number, as long as a cycle may take (table below). `Fault` ends it
   without a result; so does `Ready`, when the station restarted meanwhile.
6. **Take over**: read all result messages (list below) whose number is yours; what is missing comes again
   within 100 ms.
   Keep them where they survive your own restart. Then put acknowledge with the number on the bus until
   `ResultValid` is gone, and go back to none.
7. **A wheel is good only** when its `Outcome` is ok, and the vehicle only when `VehicleResult.Outcome` is ok.
   nok is a vehicle out of limits; fault, aborted and anything else is a vehicle that was not measured. The
   vehicle's verdict holds the lengths that have limits too; `Geometry…` says which of them it was. So it
   does the run-outs that have a limit; `WheelAxis….RunOutState` says which of them it was. The wheel's own
   `Outcome` does not: it is that of its angles, and no turn of a tie rod changes a run-out.
8. **Judge frames before you use them**: CRC, counter, and time (see the columns of the messages). A frame
   that does not count did not happen. Without a good `Status` in time take the station as lost: withdraw
   the command, treat the vehicle as not measured, and go on with (2) when it comes back.

How long a cycle may take, from the accepted start to `ResultValid` or `Fault`, follows from the station's
configuration; ask for its file. `LongestCycle` below is this value:

| mode | longest time | with the defaults |
|---|---|---|
| automatic, calibrate | `cycle.measure_timeout_s` + 6 × `database.timeout_s` | {longest_s:g} s |
| master_check | `cycle.measure_timeout_s` + 14 × `database.timeout_s` | {longest_master_s:g} s |
| adjust | that of automatic + `cycle.adjust_timeout_s` | {longest_adjust_s:g} s |
| sweep | as its section says | |

For each wheel beyond four a master check takes up to 2 × `database.timeout_s` more. A cycle that is aborted
ends sooner; `Ready` may then come up to `cycle.measure_timeout_s` after its results, while cameras that
were left behind finish.

The result messages, in the order of sending: {results}.

The steps of a controller, in Structured Text (IEC 61131-3). `Type#WORD` is a word of the value tables, in
capitals. All else that it names:

| name | what |
|---|---|
| `Status`, `Answer` | the last good frames of `Status` and `CommandAnswer`; yes is TRUE. While the \
station is silent, `Answer.LinkUp` is FALSE |
| `StatusFresh` | a good `Status` came within the last {status_ms} ms |
| `Step`, `Number` | at the beginning POWER_UP and 0; neither needs to survive a restart |
| `InStep` | time since `Step` last changed |
| `VehicleWaiting` | set by your line once for each vehicle, and again when the operator wants \
another attempt |
| `ResetAsked` | set by the operator |
| `Put` | what stands in `Command` from now on; with start also type, wheels and mode, and the \
three VIN frames, all with this number |
| `ForgetResults` | clears the received result messages |
| `ResultsComplete` | the last good frame of every result message has this number |
| `KeepResults` | stores the verdicts for the vehicle of this number, where they survive a restart, \
also of one that was started before your restart |
| `NotMeasured` | the vehicle of this number was not measured, and why; results that come later \
still count |

"""

GOOD_CYCLE = """
## A good cycle

```mermaid
sequenceDiagram
    participant P as PLC
    participant S as station
    Note over P,S: Command every 100 ms, Status and CommandAnswer every 100 ms, both ways, always
    S->>P: Status Ready
    P->>S: Vin1, Vin2, Vin3 (n)
    P->>S: Command start (n)
    S->>P: Status Busy (n)
    S->>P: CommandAnswer start (n) accepted
    P->>S: Command none
    Note over S: cameras, angles, verdict
    Note over S: record committed to the database
    S->>P: WheelUncertainty…, WheelAxis…, WheelResult… (n), each wheel
    S->>P: AxleUncertainty…, AxleResult… (n), each axle
    S->>P: VehicleReference, Geometry… (n)
    S->>P: WheelRaw…, RideHeightUsed…, SteeringWheelResult, Sweep… (n)
    S->>P: VehicleResult (n)
    S->>P: Status ResultValid (n)
    Note over S: results again every 100 ms
    P->>S: Command acknowledge (n)
    S->>P: Status (ResultValid gone), CommandAnswer acknowledge (n) accepted
    Note over S: acknowledgement committed to the database
    S->>P: Status Ready
    P->>S: Command none
```

Nothing of a result goes out before its record is committed. What is aimed at, between two programs on
one computer: busy within 10 ms of the start, the first result within 5 ms of the commit, at the 99th
percentile of ten thousand cycles. `truewheel study line-endurance` measures both on yours.
"""

HELD_AND_LOST = """
## Held results, lost communication, lost power

- Results are **held until they are acknowledged** with their number, or given up by a reset. A station
  that restarts finds in its database that the last cycle was not acknowledged, and offers it again: state
  held, the same number, the same results. The acknowledgement is stored before the station is ready
  again.
- **Safe state of the station**: no good `Command` for {command_ms} ms means that the communication is lost.
  `Ready` goes, `ErrorCode` is `communication_lost`, no start is taken. Adjusting and a sweep are aborted;
  what was prepared is forgotten, as it is after {prepare_s:g} s in any case. A cycle in another mode is
  finished, stored and held. When frames come again, the first of each message only sets the counter, and a
  start that stands on the bus already is refused with `start_stale`: the vehicle may be another one by then.
- **Safe state of the controller**: no good `Status` for {status_ms} ms. It withdraws its command and
  treats the vehicle as not measured until the station holds a result for it.
- **What is told is what is stored**: a verdict is sent after two commits, of the record and of the note
  that it is going to be told. One that takes longer than its bound is told as a fault (`store_fault`). The
  record may then land late all the same; a record behind it says what the line was told, and has the
  vehicle's last word. The station is not ready before that, and every acknowledgement, is stored: until
  then a reset is answered with `store_fault`.
- **Power lost at any moment**: before the first commit nothing is stored and nothing was told, the vehicle
  is not measured. In the milliseconds up to the second nobody knows afterwards what was told: the vehicle
  is offered, and stored, as a fault. After it the results are offered until they are acknowledged.
  `truewheel study line-power-loss` kills both sides at every step and looks.
"""

MODES_TEXT = """
## Modes

| mode | a start | ends |
|---|---|---|
| automatic | measures the marked wheels once | by itself |
| adjust | shows `LiveAngles…` of the marked wheels, again and again, and `Guidance…` where the vehicle \
type says what can be turned | \
stop: measures once more, judges, stores, reports. \
abort, lost communication, or the configured time: aborted |
| master_check | measures a master wheel; the vehicle type holds its certified angles as limits. \
Stored as a check of each rig's calibration too, where those limits are within ±10′. All four \
wheels of a type with limits of lengths are a master vehicle | by itself |
| sweep | wants one position of the steering after the other, each of which a step answers; then measures \
as automatic, straight ahead. Only of a vehicle type that says how | by itself. stop: as a fault. \
abort, lost communication: aborted |
| calibrate | records images of the calibration plate; every marked wheel is answered with `recorded` \
| by itself |

A live angle is true now only in the states inside and outside, and `LiveAge…` of the same `Shot` says how
many milliseconds ago its images were taken. It is never a verdict and never stored.

## Coming from interface 3.0

Nothing has to be done. What is new are messages with identifiers of their own, one mode, the command step,
the states sweeping and turning, which only a sweep shows, and words at the end of value tables. Three error
codes that were reserved are sent, and one is new. More result messages come with each result, before
`VehicleResult`; who reads only those of 3.0 has read all that 3.0 told. A DBC of 3.0 goes on with this
station, which then says 3.0 and has nothing of the rest.

## Coming from interface 2

What was there stays where it was: no identifier, no signal and no number of a value table has changed its
place. What a controller of interface 2 must do:

- put {major} into `Command.InterfaceMajor` (bits 60 to 63, which were 0) of every frame; without it every
  command is refused with `wrong_interface`;
- read the new result messages `WheelAxis…`, `VehicleReference` and `Geometry…` before it acknowledges, and
  `LiveAge…` where it shows live angles;
- judge counters by the largest step of each message, which is another one for live frames.

Traffic that was recorded by interface 2 is read by the DBC of this one, and by its own.
"""

SIGNAL_LEGEND = """
How to read the tables. **bits** is start|length, as in the DBC: bit 0 is the least significant bit of byte
0, bit 8 that of byte 1, bit 63 the most significant one of byte 7. A signal's start is its least
significant bit, the others follow upwards, over the ends of bytes too: 24|20 is byte 3, byte 4 and the low
half of byte 5, byte 3 being the lowest. *signed* is two's complement of that length. Physical value = raw
value × **step**; no signal has an offset. **range** is of physical values. **values** are raw values that
stand for a word, *invalid* for one: they are not multiplied. A flag is 1 for yes. Bits that no signal has
are sent as 0 and not looked at.
"""

TOOLS = """
## Buses and tools

The station's `[line]` table names interface, channel, bitrate and further options as python-can knows
them: socketcan, pcan, vector, kvaser, ixxat, slcan, remote, … A channel of
`virtual` is in one process only: no PLC reaches it. Without hardware, `truewheel run --cable NAME` puts the
station on one of two serial devices joined back to back, and `--interface slcan --channel NAME` opens the
other in another program; `truewheel line cable` only joins two. An adapter that is unplugged, off the
bus, or takes no frame for 2 s is opened again until it answers, after pauses that grow from 0.1 s to 5 s.

With `line.log` the station writes all traffic to a file; ones that are full are put aside and the oldest are
given up (`line.log_mb`, `line.log_files`), so that a restart erases nothing and the disk does not fill.

| command | does |
|---|---|
| `truewheel line check` | tries all of this out on a station; \
`--simulated` on one of its own |
| `truewheel line plc --vin VIN` | plays the PLC for some vehicles |
| `truewheel line plc --scenario configs/line-scenarios.toml` | plays good and bad days |
| `truewheel line monitor` | shows decoded traffic as it changes, errors marked; reads and writes \
candump, ASC and BLF |
| `truewheel line monitor --cycles` | shows one line for each start: VIN, result, times |
| `truewheel line cable` | joins two serial devices back to back |
"""
