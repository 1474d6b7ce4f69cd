"""Draws docs/images/mounting.png, how well camber is known over head positions and load.

`python tools/mounting_map.py` draws it. No images: cells as three heads see them, with noise of images and of
a calibration from the plate, go through the model of loads that measures. The loads are the simulator's,
Gaussian and wave.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from alignment.arrays import Array
from alignment.units import ARCMIN
from alignment.wheel.load_cells import Cells
from alignment.wheel.load_model import fit_load
from sensors.formats import TyreLoad
from sensors.simulation.deformation import angular_shapes, radial_shapes

IMAGE = Path(__file__).resolve().parents[1] / "docs" / "images" / "mounting.png"
APART = (50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 105.0, 110.0, 120.0, 130.0, 140.0)
"""Degrees between the upper head and each of the lower ones."""
BULGES = (1.0, 2.0, 4.0, 6.0, 8.0)
WIDTHS = (19.0, 25.0, 31.0)
NOISE, POINTS, HALF_VIEW = 0.02, 12_000, 10.5
RIM, TREAD = 197.0, 325.0
# Of a head's patch by a calibration from the plate: rise at its middle, leans, shifts of its own and of all.
RISE, LEAN, SHIFT, COMMON = 0.0028, 2.5e-5, 0.0006, 0.0026
ROUNDS = 3


def cells_of(heads: tuple[float, ...]) -> Cells:
    """Cells on rings of 4 mm, ten over each head's view, contact at −y."""
    radii, columns = np.arange(203.0, 322.0, 4.0), 10
    ring, head, column = (
        each.ravel()
        for each in np.meshgrid(
            np.arange(len(radii)), np.arange(len(heads)), np.arange(columns), indexing="ij"
        )
    )
    angle = np.radians(np.array(heads)[head] + np.linspace(-HALF_VIEW, HALF_VIEW, columns)[column])
    places = radii[ring][:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    slope = (-0.25 / 60.0 * (radii[ring] - 255.0) / radii[ring])[:, None]
    moves = np.column_stack([np.ones(len(ring)), places, slope * places])
    weight = np.full(len(ring), POINTS / len(ring))
    number = 2 * np.arange(len(ring))
    flat, bends = np.zeros(len(ring)), np.zeros((len(ring), 3))
    return Cells(number, ring, head, weight, flat, places, moves, bends, NOISE, NOISE, len(heads))


def amounts_of(heads: tuple[float, ...]) -> Array:
    """(5 H, 5 H) covariance of the heads' moves by the calibration."""
    out = np.zeros((5 * len(heads), 5 * len(heads)))
    for k, angle in enumerate(np.radians(heads)):
        outward = np.array([np.cos(angle), np.sin(angle)])
        frame = np.column_stack([outward, [-outward[1], outward[0]]])
        local = np.zeros((5, 5))
        local[0, :2] = 1.0, -266.0  # a lean turns about the patch's middle
        local[1:3, 1:3] = local[3:, 3:] = frame
        mine = slice(5 * k, 5 * k + 5)
        out[mine, mine] = local @ np.diag(np.array([RISE, LEAN, LEAN, SHIFT, SHIFT]) ** 2) @ local.T
    for along in (3, 4):
        rows = np.arange(along, len(out), 5)
        out[np.ix_(rows, rows)] += COMMON**2
    return out


def trials(heads: tuple[float, ...], bulge_mm: float, rng: np.random.Generator) -> tuple[float, float]:
    """Median stated 95 % half width of camber, and largest error, arcminutes, over shapes and widths."""
    cells, amounts, down = cells_of(heads), amounts_of(heads), np.array([0.0, -1.0])
    root = np.linalg.cholesky(amounts + 1e-18 * np.eye(len(amounts)))
    share = (cells.radius - RIM) / (TREAD - RIM)
    stated, errors = [], []
    for width in WIDTHS:
        for shape in ("gaussian", "wave"):
            load = TyreLoad(bulge_mm, width, shape)
            even = angular_shapes(load, cells.angle_from(down))[0]
            height = bulge_mm * radial_shapes(load, share)[0] * even
            height = height + NOISE / np.sqrt(cells.weight) * rng.standard_normal(len(height))
            height = height + cells.by_head() @ (root @ rng.standard_normal(len(root)))
            seen, model = replace(cells, height=height), None
            for _ in range(ROUNDS):
                model = fit_load(seen, down, amounts, model, elsewhere=False)
            assert model is not None
            stated.append(1.96 * float(np.sqrt(model.covariance[1, 1])) / ARCMIN)
            errors.append(abs(float(model.turn[1])) / ARCMIN)
    return float(np.median(stated)), max(errors)


def main() -> int:
    """Compute the map and draw it; returns the exit status."""
    rng = np.random.default_rng(1)
    table = np.array(
        [[trials((90.0, 90.0 + apart, 90.0 - apart), bulge, rng) for apart in APART] for bulge in BULGES]
    )
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, values, title in zip(
        panels, (table[:, :, 0], table[:, :, 1]), ("stated ± (95 %), median", "largest error"), strict=True
    ):
        image = axes.imshow(np.minimum(values, 0.4), origin="lower", aspect="auto", cmap="YlOrRd", vmin=0.0)
        for row, column in np.ndindex(values.shape):
            axes.text(column, row, f"{values[row, column]:.2f}", ha="center", va="center", fontsize=6)
        axes.set_xticks(range(len(APART)), [f"{apart:g}" for apart in APART])
        axes.set_yticks(range(len(BULGES)), [f"{bulge:g}" for bulge in BULGES])
        axes.set_xlabel("lower heads away from the top, degrees")
        axes.set_title(f"camber, arcmin: {title}", fontsize=9)
        figure.colorbar(image, ax=axes)
    panels[0].set_ylabel("bulge over the patch, mm")
    figure.savefig(IMAGE, dpi=90)
    for k, apart in enumerate(APART):
        line = "  ".join(f"{stated:.3f}/{error:.3f}" for stated, error in table[:, k])
        sys.stdout.write(f"{apart:5.0f}°  {line}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
