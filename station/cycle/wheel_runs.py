"""All wheels of a cycle at once: each is measured in its rig's thread, within one bound."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace

from station.cycle.under_way import CycleUnderWay
from station.cycle.wheels import SeriesPlan, WheelPosition, WheelResult, WheelThreads, result_of

POLL_S = 0.02


def run_wheels(
    threads: WheelThreads,
    cycle: CycleUnderWay,
    positions: Sequence[WheelPosition],
    bound_s: float,
    clock: Callable[[], float],
    given_up: Callable[[], bool],
    done: Callable[[WheelResult], None],
    *,
    kept: bool = True,
) -> None:
    """Measure each wheel as the cycle's plan says: one exposure, or a series.

    Parameters
    ----------
    threads
        Of the positions.
    cycle
        Its zero measurements correct.
    positions
        Armed.
    bound_s
        For all wheels together; those that are late have a result that says so.
    clock
        Monotonic seconds.
    given_up
        Asked between; true ends it, and what is not done has no result.
    done
        Takes each result when it comes.
    kept
        Whether the exposures of a series are kept, where the plan keeps any.
    """
    ended = threading.Event()
    plan = cycle.plan if kept or cycle.plan is None else replace(cycle.plan, memory=None)
    running = {_begin(threads, cycle, plan, position, ended, bound_s): position for position in positions}
    deadline = clock() + bound_s
    stopped = False
    while running and not (stopped := given_up()) and clock() < deadline:
        ready, _ = wait(running, POLL_S, FIRST_COMPLETED)
        for future in ready:
            done(result_of(future, running.pop(future)))
    if running:
        # Nobody waits for the rest of their exposures.
        ended.set()
        threads.leave(running)
        if not stopped:
            for position in running.values():
                done(position.late(bound_s))


def _begin(
    threads: WheelThreads,
    cycle: CycleUnderWay,
    plan: SeriesPlan | None,
    position: WheelPosition,
    ended: threading.Event,
    bound_s: float,
) -> Future[WheelResult]:
    if plan is None:
        return threads.submit(position.name, position.run, cycle.zeros)
    worker = threads.measuring(position.name)
    return threads.submit(position.name, position.run_series, plan, worker, ended, bound_s, cycle.zeros)
