"""The house in figures: `python tools/house.py [PACKAGE …]` prints rooms, floors, arrows and circles.

A room is a folder of a package, or a module that lies loose beside them; an arrow is an import between
two rooms. The floor of a room is the longest way down from it; rooms in a circle share one.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Iterable
from pathlib import Path

import grimp
from grimp import ImportGraph

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("station", "db", "sensors", "alignment")


def arrows(graph: ImportGraph, package: str) -> dict[str, set[str]]:
    """Return which rooms of a package each of its rooms imports."""
    rooms = {child: graph.find_descendants(child) | {child} for child in graph.find_children(package)}
    of = {module: room for room, modules in rooms.items() for module in modules}
    return {
        room: {of[target] for module in modules for target in graph.find_modules_directly_imported_by(module)
               if target in of} - {room}
        for room, modules in rooms.items()
    }  # fmt: skip


def circles(out: dict[str, set[str]]) -> list[set[str]]:
    """Return the sets of rooms that reach each other."""
    reach = {room: _reached(out, room) for room in out}
    found: list[set[str]] = []
    for room in sorted(out):
        mutual = {other for other in reach[room] if room in reach[other]} | {room}
        if len(mutual) > 1 and mutual not in found:
            found.append(mutual)
    return found


def _reached(out: dict[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        for target in out[waiting.pop()] - seen:
            seen.add(target)
            waiting.append(target)
    return seen


def floors(out: dict[str, set[str]]) -> int:
    """Return how many floors the rooms need."""
    circle_of = {room: min(circle) for circle in circles(out) for room in circle}
    name = {room: circle_of.get(room, room) for room in out}
    below = {
        name[room]: {name[t] for r in out if name[r] == name[room] for t in out[r]} - {name[room]}
        for room in out
    }
    depth: dict[str, int] = {}

    def floor(room: str) -> int:
        if room not in depth:
            depth[room] = 1 + max((floor(target) for target in below[room]), default=0)
        return depth[room]

    return max(map(floor, below), default=0)


def main(packages: Iterable[str]) -> None:
    """Print one line for each package."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    print("package    folders  loose  floors  arrows  circles  modules  median  longest")
    for package in packages:
        out = arrows(graph, package)
        folders = [room for room in out if graph.find_children(room)]
        files = [
            path for path in (ROOT / package).rglob("*.py")
            if path.name != "__init__.py" and "migrations" not in path.parts
        ]  # fmt: skip
        lines = [len(path.read_text(encoding="utf-8").splitlines()) for path in files]
        print(
            f"{package:9} {len(folders):8} {len(out) - len(folders):6} {floors(out):7}"
            f" {sum(map(len, out.values())):7} {len(circles(out)):8} {len(lines):8}"
            f" {statistics.median(lines):7.0f} {max(lines):8}"
        )
        for circle in circles(out):
            print(f"  circle: {', '.join(sorted(circle))}")


if __name__ == "__main__":
    main(sys.argv[1:] or PACKAGES)
