"""Mixed pictures: thirty ways in which the images of one shot may not belong together.

A camera that hangs gives the image of a moment ago, a driver swaps or shifts images, two wheels leave their
light in one exposure. Each kind is made of rendered images of a wheel, and of it or another one moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from alignment.measure import measure_wheel
from alignment.prepared import PreparedRig
from alignment.units import ARCMIN
from alignment.values import Image, MeasureSettings, StereoImages, WheelMeasurement
from sensors.simulation import WheelPose, WheelScene, draw_scene
from station.figures import Row
from station.studies.wheels import StudyRig, errors_arcmin, exposed, lights

Shot = list[StereoImages]

_CAMBER, _TOE = math.radians(0.6), math.radians(-0.3)
#: Scenes that the mixtures are made of: the wheel moved by millimetres along x, y, z and turned by degrees.
_MOVES: dict[str, tuple[tuple[float, float, float], tuple[float, float]]] = {
    "0.05 mm out": ((0.0, 0.0, 0.05), (0.0, 0.0)),
    "0.5 mm out": ((0.0, 0.0, 0.5), (0.0, 0.0)),
    "0.5 mm back": ((0.5, 0.0, 0.0), (0.0, 0.0)),
    "0.5 mm up": ((0.0, 0.5, 0.0), (0.0, 0.0)),
    "0.05° of camber": ((0.0, 0.0, 0.0), (0.05, 0.0)),
    "0.5° of toe": ((0.0, 0.0, 0.0), (0.0, 0.5)),
}


@dataclass(frozen=True, eq=False)
class Mixture:
    """One kind: its name and the shot it gives."""

    name: str
    images: Shot


def _scenes(rig: StudyRig, seed: int) -> dict[str, WheelScene]:
    def scene(shift: tuple[float, float, float], turn: tuple[float, float], tyre: int = 0) -> WheelScene:
        rng = np.random.default_rng([seed, 41, tyre])
        camber, toe = _CAMBER + math.radians(turn[0]), _TOE + math.radians(turn[1])
        pose = WheelPose(camber=camber, toe=toe, offset_mm=shift)
        return draw_scene(rig.spec, rig.side, pose, rng, "touring", seed=seed + tyre)

    out = {"now": scene((0.0, 0.0, 0.0), (0.0, 0.0))}
    out |= {name: scene(shift, turn) for name, (shift, turn) in _MOVES.items()}
    other = scene((1.0, -1.0, 1.0), (0.3, 0.2), tyre=1)
    out["another tyre"] = replace(other, projectors=out["now"].projectors)
    return out


def _stale(now: Shot, old: Shot, cameras: tuple[tuple[int, int], ...]) -> Shot:
    """Images of now, those of some cameras (head, side) from another shot."""
    out = list(now)
    for head, side in cameras:
        before = old[head]
        out[head] = replace(out[head], right=before.right) if side else replace(out[head], left=before.left)
    return out


def _each(
    shot: Shot, change: Callable[[Image], Image], sides: str = "lr", heads: tuple[int, ...] = ()
) -> Shot:
    """Images, some of them changed."""
    out = []
    for k, pair in enumerate(shot):
        mine = not heads or k in heads
        left = change(pair.left) if mine and "l" in sides else pair.left
        right = change(pair.right) if mine and "r" in sides else pair.right
        out.append(StereoImages(left, right))
    return out


def _rows(count: int) -> Callable[[Image], Image]:
    return lambda image: np.roll(image, count, axis=0)


def _columns(count: int) -> Callable[[Image], Image]:
    return lambda image: np.roll(image, count, axis=1)


def _torn(now: Shot, old: Shot) -> Shot:
    """The upper halves of the left images are of another shot."""

    def half(new: Image, before: Image) -> Image:
        out = new.copy()
        out[: len(out) // 2] = before[: len(out) // 2]
        return out

    return [StereoImages(half(a.left, b.left), a.right) for a, b in zip(now, old, strict=True)]


def _doubled(now: Shot, old: Shot, heads: tuple[int, ...]) -> Shot:
    """Light of two shots in one exposure."""

    def both(new: Image, before: Image) -> Image:
        mean = 0.5 * (new.astype(np.float64) + before)
        return mean.astype(np.uint8) if new.dtype == np.uint8 else mean.astype(np.uint16)

    return [
        StereoImages(both(a.left, b.left), both(a.right, b.right)) if k in heads else a
        for k, (a, b) in enumerate(zip(now, old, strict=True))
    ]


def _pictured(rig: StudyRig, scene: WheelScene, rng: np.random.Generator) -> Shot:
    """Rendered images of a scene before the true cameras."""
    return exposed(lights(scene, rig.true), scene, rng)


def mixtures(
    rig: StudyRig,
    seed: int,
    picture: Callable[[StudyRig, WheelScene, np.random.Generator], Shot] = _pictured,
) -> tuple[WheelScene, list[Mixture]]:
    """Take pictures of the scenes, and make the thirty mixtures; also the scene that counts as true."""
    rng = np.random.default_rng([seed, 42])
    scenes = _scenes(rig, seed)
    shots = {name: picture(rig, scene, rng) for name, scene in scenes.items()}
    now = shots["now"]
    out = []
    for name in (*_MOVES, "another tyre"):
        out.append(Mixture(f"one camera from {name}", _stale(now, shots[name], ((1, 0),))))
        out.append(Mixture(f"one head from {name}", _stale(now, shots[name], ((1, 0), (1, 1)))))
    lefts = tuple((k, 0) for k in range(rig.spec.heads))
    for name in ("0.05 mm out", "0.5 mm out", "0.05° of camber", "0.5° of toe", "another tyre"):
        out.append(Mixture(f"all left images from {name}", _stale(now, shots[name], lefts)))
    every = tuple(range(rig.spec.heads))
    out += [
        Mixture("one camera 1 row down", _each(now, _rows(1), "l", (2,))),
        Mixture("one camera 16 rows down", _each(now, _rows(16), "l", (2,))),
        Mixture("all left images 1 row down", _each(now, _rows(1), "l")),
        Mixture("one head 16 rows down", _each(now, _rows(16), "lr", (2,))),
        Mixture("all images 1 row down", _each(now, _rows(1))),
        Mixture("all images 16 rows down", _each(now, _rows(16))),
        Mixture("one camera 1 column aside", _each(now, _columns(1), "l", (2,))),
        Mixture("all images 16 columns aside", _each(now, _columns(16))),
        Mixture("left halves torn, 0.5° of toe", _torn(now, shots["0.5° of toe"])),
        Mixture("two wheels in one exposure, 0.5° of toe", _doubled(now, shots["0.5° of toe"], every)),
        Mixture("two wheels before one head, 0.05° of camber", _doubled(now, shots["0.05° of camber"], (0,))),
    ]
    return scenes["now"], out


def mixture_row(number: int, mixture: Mixture, scene: WheelScene, known: PreparedRig) -> Row:
    """Measure a mixture: a row of the table."""
    result = measure_wheel(mixture.images, known, MeasureSettings())
    row: Row = {
        "mixture": number,
        "kind": mixture.name,
        "outcome": "refused",
        "reason": None,
        "largest_error_arcmin": None,
        "stated_u_arcmin": None,
        "error_over_u": None,
        "evidence": None,
    }
    if not isinstance(result, WheelMeasurement):
        return {**row, "reason": str(result.code)}
    errors = np.abs(errors_arcmin(result, scene))
    stated = np.array([result.camber_u, result.toe_u]) / ARCMIN
    return {
        **row,
        "outcome": "measured" if result.warning is None else "warned",
        "largest_error_arcmin": float(errors.max()),
        "stated_u_arcmin": float(stated[int((errors / stated).argmax())]),
        "error_over_u": float((errors / stated).max()),
        "evidence": result.knock_evidence,
    }


def mixture_table(rows: list[Row]) -> str:
    """Rows of `mixture_row` as a table."""
    lines = ["| mixture | outcome | error, ′ | over stated u |", "|---|---|---|---|"]
    for row in rows:
        if row["outcome"] == "refused":
            lines.append(f"| {row['kind']} | refused ({row['reason']}) | | |")
        else:
            error, ratio = float(row["largest_error_arcmin"] or 0.0), float(row["error_over_u"] or 0.0)
            lines.append(f"| {row['kind']} | {row['outcome']} | {error:.3f} | {ratio:.1f} |")
    return "\n".join(lines)
