"""`measure_wheel` on six images in memory, beside dense stereo and a RANSAC plane on the same images.

The least that the station must reach; `truewheel bench` prints the same with the goals of the product.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys

from station.rehearsal import REPEATS, goals, run

LEAST_SPEEDUP = 20.0


def main() -> int:
    """Print the figures; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    options = parser.parse_args()
    figures = run(options.repeats)
    met = goals(figures, LEAST_SPEEDUP, math.inf)
    if options.json:
        print(json.dumps({"figures": figures, "goals_met": met, "cores": os.cpu_count()}))
    else:
        for name, value in figures.items():
            print(f"{name:28s} {value:12.3f}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
