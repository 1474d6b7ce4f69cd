"""The programs that the line interface's description shows: a controller's steps, and the frames in C.

The tests run both as they stand on the page: the C code is compiled, the steps are driven against a station.
"""

PLC_PROGRAM = """
```iecst
(* Once in each scan, after the frames were read and judged. *)
IF NOT StatusFresh THEN                              (* the station is silent, or not yet heard *)
    IF Step = Step#STARTED OR Step = Step#WAITING THEN
        NotMeasured(Number, Error#COMMUNICATION_LOST);
    END_IF;
    Put(Code#NONE, 0);  Step := Step#POWER_UP;
END_IF;

CASE Step OF
    Step#POWER_UP:                                   (* after each vehicle too: where does it stand? *)
        IF NOT StatusFresh OR NOT Answer.LinkUp OR Status.Handshake = Handshake#STARTING THEN
            ;                                        (* wait *)
        ELSIF Status.ResultValid OR Status.Busy THEN (* of a start before this program's restart *)
            Number := Status.Sequence;  Step := Step#WAITING;
        ELSIF Status.Ready THEN
            Step := Step#READY;
        ELSIF Status.Fault AND (ResetAsked OR InStep > T#10s) THEN
            ResetAsked := FALSE;
            Number := NextNumber();  Put(Code#RESET, Number);  Step := Step#RESETTING;
        END_IF;

    Step#RESETTING:                                  (* cameras are connected anew, which takes its time *)
        IF (Status.Sequence = Number AND Status.Handshake <> Handshake#RESETTING) OR InStep > T#60s THEN
            Put(Code#NONE, 0);  Step := Step#POWER_UP;
        END_IF;

    Step#READY:
        IF NOT Status.Ready THEN
            Step := Step#POWER_UP;
        ELSIF VehicleWaiting THEN
            VehicleWaiting := FALSE;                 (* each vehicle is started once *)
            ForgetResults();
            Number := NextNumber();  Put(Code#START, Number);  Step := Step#STARTED;
        END_IF;

    Step#STARTED:
        IF Answer.Code = Code#START AND Answer.Sequence = Number AND Answer.Answer = Answer#ACCEPTED THEN
            Put(Code#NONE, 0);  Step := Step#WAITING;
        ELSIF Answer.Code = Code#START AND Answer.Sequence = Number AND Answer.Answer = Answer#REFUSED
                AND (Answer.ErrorCode <> Error#VIN_INCOMPLETE OR InStep > T#2s) THEN
            Put(Code#NONE, 0);  Step := Step#REFUSED;
        ELSIF InStep > T#2s THEN                     (* no answer *)
            NotMeasured(Number, Error#COMMUNICATION_LOST);
            Put(Code#NONE, 0);  Step := Step#NOT_MEASURED;
        END_IF;

    Step#REFUSED:                                    (* nothing has happened *)
        NotMeasured(Number, Answer.ErrorCode);
        Step := Step#POWER_UP;

    Step#WAITING:
        IF Status.ResultValid AND Status.Sequence = Number AND ResultsComplete(Number) THEN
            KeepResults(Number);
            Put(Code#ACKNOWLEDGE, Number);  Step := Step#TAKEN;
        ELSIF Answer.Code = Code#START AND Answer.Sequence = Number AND Answer.Answer = Answer#REFUSED THEN
            Step := Step#REFUSED;                    (* by the cycle, such as of an unknown vehicle type *)
        ELSIF Status.Fault OR (Status.Ready AND InStep > T#1s) OR InStep > LongestCycle THEN
            NotMeasured(Number, Status.ErrorCode);
            Step := Step#NOT_MEASURED;
        END_IF;

    Step#NOT_MEASURED:                               (* what still runs is aborted and taken over *)
        IF Status.Busy AND Status.Sequence = Number THEN
            Put(Code#ABORT, Number);
        ELSE
            Put(Code#NONE, 0);  Step := Step#POWER_UP;
        END_IF;

    Step#TAKEN:
        IF NOT Status.ResultValid OR Status.Sequence <> Number THEN
            Put(Code#NONE, 0);  Step := Step#POWER_UP;
        END_IF;
END_CASE;
```

```iecst
FUNCTION NextNumber : USINT                          (* 1 to 255; never the one of the last start or answer *)
    IF Status.Sequence <> 0 THEN
        Number := Status.Sequence;
    END_IF;
    Number := Number MOD 255 + 1;
    IF Number = Answer.Sequence THEN
        Number := Number MOD 255 + 1;
    END_IF;
    NextNumber := Number;
END_FUNCTION
```
"""

C_CODE = """
```c
#include <stdbool.h>
#include <stdint.h>

static uint8_t crc8(uint8_t crc, uint8_t byte)      /* polynomial 0x1D */
{
    crc ^= byte;
    for (int bit = 0; bit < 8; bit++)
        crc = (uint8_t)(crc & 0x80 ? (crc << 1) ^ 0x1D : crc << 1);
    return crc;
}

uint8_t e2e_crc(const uint8_t data[8], uint16_t data_id)
{
    uint8_t crc = crc8(crc8(0x00, data_id & 0xFF), data_id >> 8);
    for (int k = 1; k < 8; k++)
        crc = crc8(crc, data[k]);
    return crc;
}

/* A sender: one counter for each message, of any value from 0 to 14 at the beginning. */
void e2e_protect(uint8_t data[8], uint16_t data_id, uint8_t *counter)
{
    data[1] = (uint8_t)((data[1] & 0xF0) | *counter);
    data[0] = e2e_crc(data, data_id);
    *counter = (uint8_t)((*counter + 1) % 15);
}

/* A receiver: one for each message, all zero at the beginning and after a lost communication. Data id and
   largest step are those of the message, as the table below gives them. */
struct e2e_receiver { bool heard, unsure; uint8_t last; };

bool e2e_counts(struct e2e_receiver *receiver, const uint8_t data[8], uint16_t data_id, int largest_step)
{
    uint8_t counter = data[1] & 0x0F;
    if (counter > 14 || data[0] != e2e_crc(data, data_id))
        return false;
    int step = receiver->heard ? (counter + 15 - receiver->last) % 15 : 0;
    bool first = !receiver->heard;
    receiver->heard = true;
    receiver->last = counter;
    if (first || step == 0)
        return false;
    if (step > largest_step) {
        receiver->unsure = true;
        return false;
    }
    bool counts = !receiver->unsure;
    receiver->unsure = false;
    return counts;
}

/* A signal as the tables below give it, start|length: its raw value. */
int64_t get_signal(const uint8_t data[8], int start, int length, bool is_signed)
{
    uint64_t raw = 0;
    for (int k = 0; k < length; k++)
        raw |= (uint64_t)(data[(start + k) / 8] >> (start + k) % 8 & 1) << k;
    if (is_signed && raw >> (length - 1))
        return (int64_t)raw - ((int64_t)1 << length);
    return (int64_t)raw;
}

void put_signal(uint8_t data[8], int start, int length, int64_t raw)
{
    for (int k = 0; k < length; k++) {
        uint8_t bit = (uint8_t)(1u << (start + k) % 8);
        if ((uint64_t)raw >> k & 1)
            data[(start + k) / 8] |= bit;
        else
            data[(start + k) / 8] &= (uint8_t)~bit;
    }
}
```
"""
