"""Draws the README's pictures from a simulated wheel: `python tools/pictures.py` writes into docs/images."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from alignment.imaging import extract_many
from alignment.measure import measure_wheel
from alignment.stereo import match_lines
from alignment.values import MeasureSettings, WheelMeasurement
from sensors.simulation import RIG_SPECS, build_rig, draw_pose, draw_scene, simulate_shot

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "images"
SEED = 4


def main() -> None:
    """Render, measure, draw."""
    rng = np.random.default_rng(SEED)
    spec = RIG_SPECS["standard"]
    rig = build_rig(spec, "front_left", "left", rng)
    scene = draw_scene(spec, "left", draw_pose(rng, math.radians(-1.0), math.radians(0.3)), rng, seed=SEED)
    images = simulate_shot(scene, rig, rng).images
    settings = MeasureSettings()
    wheel = measure_wheel(images, rig, settings)
    assert isinstance(wheel, WheelMeasurement)
    lines = [extract_many([pair.left, pair.right]) for pair in images]

    first = lines[0][0]
    assert first is not None
    figure, axes = plt.subplots(figsize=(8.0, 6.4))
    axes.imshow(images[0].left, cmap="gray", vmax=200)
    for k in range(first.count):
        part = first.points[first.starts[k] : first.starts[k + 1]]
        axes.plot(part[:, 0], part[:, 1], ".", markersize=1.2)
    axes.plot(*first.crosses.points.T, "o", markersize=7, markerfacecolor="none", markeredgecolor="white")
    axes.set_axis_off()
    figure.savefig(FOLDER / "lines.png", dpi=90, bbox_inches="tight", pad_inches=0.02)

    figure = plt.figure(figsize=(7.0, 6.4))
    space = figure.add_subplot(projection="3d", computed_zorder=False)
    normal, centre = wheel.normal, wheel.centre
    for head, pair in zip(rig.heads, lines, strict=True):
        left, right = pair
        assert left is not None
        assert right is not None
        points = match_lines(left, right, head, settings.depth_range_mm).points
        height = (points - centre) @ normal
        near = np.abs(height) < 30.0
        drawn = space.scatter(*points[near][::4].T, c=height[near][::4], s=0.6, cmap="viridis")
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    e1 = np.cross(normal, [0.0, 1.0, 0.0])
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(normal, e1)
    for radius in (205.0, 320.0):
        circle = centre + radius * (np.outer(np.cos(turn), e1) + np.outer(np.sin(turn), e2))
        space.plot(*circle.T, color="tab:red", linewidth=1.0)
    axis = np.array([centre, centre + 150.0 * normal])
    space.plot(*axis.T, color="tab:red", linewidth=2.0)
    space.set(xlabel="x, mm", ylabel="y, mm", zlabel="z, mm", zlim=(-100, 150), box_aspect=(1, 1, 0.4))
    space.view_init(elev=55, azim=-70)
    figure.colorbar(drawn, shrink=0.5, label="height above the tyre plane, mm")
    figure.savefig(FOLDER / "wheel.png", dpi=90, bbox_inches="tight", pad_inches=0.1)


if __name__ == "__main__":
    main()
