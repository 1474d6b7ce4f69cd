"""A process that compiles what it is told: ``python -m station.warm_up.worker``.

Reads one JSON object a line, compiles, answers with one line, and ends when its input does.
"""

from __future__ import annotations

import json
import os
import sys
import time

from alignment.errors import TruewheelError
from alignment.kernels import UNSAVED
from station.warm_up.needs import Needed, load

LESS_URGENT = 5  # nice: the station's own threads go first


def main() -> None:
    """Serve until the input ends."""
    os.nice(LESS_URGENT)
    for line in sys.stdin:
        one = Needed(**json.loads(line))
        started = time.perf_counter()
        answer: dict[str, object] = {"compiled": False, "error": None}
        try:
            answer["compiled"] = load(one)
        except TruewheelError as error:
            answer["error"] = str(error)
        answer |= {"seconds": time.perf_counter() - started, "unsaved": next(iter(UNSAVED.values()), None)}
        print(json.dumps(answer), flush=True)  # noqa: T201  (the answer)


if __name__ == "__main__":
    main()
