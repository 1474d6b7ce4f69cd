"""From a scene and a calibrated rig to images.

Open3D casts rays at the corners of small cells of pixels, and at every sample of the cells in which
something begins, ends or shades; it tells what is seen. Where the wheel is seen, each sample's ray is then
brought onto the analytic surface (`sensors.simulation.surface`), so that Open3D's single precision and
the facets of the mesh do not matter: hits lie within nanometres of the surface.

Limits: one bounce of light; shadows have sharp edges, and relief of less than a few millimetres
(rings, letters) casts none; obstacles thinner than four pixels may be missed; the camera's lens is sharp at
all distances but for one constant blur; of a wheel that turns during the exposure a few moments are averaged.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, Index, Singles
from alignment.geometry import PosedCamera, RigidTransform
from alignment.values import Image, RigCalibration
from sensors.camera import CameraSettings, Frame
from sensors.shot import HeadFrames, WheelShot
from sensors.simulation import shading
from sensors.simulation.optics import develop, integrate, sample_offsets
from sensors.simulation.projector import PACKED, may_light
from sensors.simulation.scene import Obstacle, WheelScene
from sensors.simulation.shading import CELL, MIXED, NOTHING, SMOOTH, Light, Skin
from sensors.simulation.tyre import TEXTURE_HALF_WIDTH_MM, Material, Tyre, casting_scene, tensor

SAMPLES = 2
SIMULATED_TIME = datetime(2026, 1, 1, tzinfo=UTC)
_TWIST = 0.002  # of the depth: a cell that is less flat hides an edge
_SHADOW_END = 0.998  # of the way from a projector to a point, so that a surface does not shade itself
_WHEEL, _VALVE = 0, 1


class _Things:
    """All geometry of a scene in the tyre frame; kind 0 is the wheel, 1 its valve, 2… obstacles."""

    def __init__(self, scene: WheelScene, tyre_from_rig: RigidTransform) -> None:
        self._casters: list[tuple[Any, int]] = [(scene.deformed_tyre.scene, 0)]
        if scene.obstacles:
            meshes = [(tyre_from_rig.apply(item.vertices), item.triangles) for item in scene.obstacles]
            self._casters.append((casting_scene(meshes), 2))
        self.materials = _material_rows(scene.tyre, scene.obstacles)

    def first_hit(self, origin: Array, rays: Array) -> tuple[Array, Index, Array]:
        """Depth (N,), kind (N,) (−1 for nothing) and facet normal (N, 3) of rays (N, 3) from one point."""
        packed = np.empty((len(rays), 6), dtype=np.float32)
        packed[:, :3], packed[:, 3:] = origin, rays
        depth = np.full(len(rays), np.inf)
        kind = np.full(len(rays), -1)
        normal = np.zeros((len(rays), 3))
        for caster, first in self._casters:
            hit = caster.cast_rays(tensor(packed, np.float32))
            t = hit["t_hit"].numpy()
            nearer = t < depth
            depth[nearer] = t[nearer]
            kind[nearer] = hit["geometry_ids"].numpy()[nearer].astype(np.int64) + first
            normal[nearer] = hit["primitive_normals"].numpy()[nearer]
        return depth, kind, normal

    def lit(self, points: Array, projectors: Array) -> Index:
        """Bits (N,), one per packed projector, that tell which of them see the points (N, 3)."""
        bits = np.zeros(len(points), dtype=np.int64)
        packed = np.empty((len(points), 6), dtype=np.float32)
        for index, projector in enumerate(projectors):
            packed[:, :3] = projector[:3]
            packed[:, 3:] = points - projector[:3]
            free = np.ones(len(points), dtype=np.bool_)
            for caster, _ in self._casters:
                free &= ~caster.test_occlusions(tensor(packed, np.float32), tfar=_SHADOW_END).numpy()
            bits |= free.astype(np.int64) << index
        return bits


def _row(material: Material) -> Array:
    return np.array([material.albedo, material.gloss, material.roughness])


def _material_rows(tyre: Tyre, obstacles: Sequence[Obstacle]) -> Array:
    return np.array([_row(tyre.rubber), _row(tyre.rim), *(_row(obstacle.material) for obstacle in obstacles)])


def _skin(tyre: Tyre) -> Skin:
    materials = [TEXTURE_HALF_WIDTH_MM, tyre.rim_edge_mm, tyre.letter_albedo]
    return Skin(tyre.texture, np.concatenate([materials, _row(tyre.rubber), _row(tyre.rim)]))


def _light(scene: WheelScene, tyre_from_rig: RigidTransform, points: Array) -> Light:
    """Light that can fall on points (N, 3) of the tyre frame; projectors that miss them all are left out."""
    packed = [projector.packed(tyre_from_rig) for projector in scene.projectors]
    vectors = np.array([vector for vector, _ in packed]).reshape(len(packed), PACKED)
    used = [k for k in range(len(packed)) if may_light(points, 0.0, k, vectors)]
    lines = np.zeros((len(used), 2, max((packed[k][1].shape[1] for k in used), default=1)))
    for row, k in zip(lines, used, strict=True):
        row[:, : packed[k][1].shape[1]] = packed[k][1]
    around = np.zeros(9)
    around[0] = scene.ambient
    if scene.sun is not None:
        towards = tyre_from_rig.apply_vectors(np.array(scene.sun.towards))
        around[1:4] = towards / np.linalg.norm(towards)
        around[4:7] = tyre_from_rig.apply(np.array(scene.sun.through_mm))
        around[7:] = scene.sun.radius_mm, scene.sun.level
    return Light(vectors[used], lines, around)


def render_samples(
    scene: WheelScene, camera: PosedCamera, rig_from_tyre: RigidTransform, samples: int = SAMPLES
) -> Singles:
    """Radiance (samples · height, samples · width) that the camera sees, before its lens blurs it.

    Each pixel has samples × samples rays, symmetric about its centre (`optics.sample_offsets`). Radiance 1
    fills the sensor's range at the reference exposure.
    """
    tyre_from_rig = rig_from_tyre.inverse()
    tyre_from_camera = tyre_from_rig @ camera.rig_from_camera
    origin, rotation = tyre_from_camera.translation.copy(), np.ascontiguousarray(tyre_from_camera.rotation)
    model = camera.model
    things = _Things(scene, tyre_from_rig)
    skin, surface = _skin(scene.tyre), scene.deformed_tyre.surface

    rows, columns = -(-model.height // CELL), -(-model.width // CELL)
    v, u = np.mgrid[0 : rows + 1, 0 : columns + 1] * float(CELL) - 0.5
    nodes = model.normalise(np.column_stack([u.ravel(), v.ravel()]))
    rays = np.column_stack([nodes, np.ones(len(nodes))]) @ rotation.T
    depth, kind, _ = things.first_hit(origin, rays)
    hit = kind >= 0
    points = origin + depth[hit, None] * rays[hit]
    light = _light(scene, tyre_from_rig, points)
    lit = np.zeros(len(rays), dtype=np.int64)
    lit[hit] = things.lit(points, light.projectors)
    shape = rows + 1, columns + 1
    cells = _classify(kind.reshape(shape), depth.reshape(shape), lit.reshape(shape), len(light.projectors))

    out = np.zeros((model.height * samples, model.width * samples), dtype=np.float32)
    nodes, depth, packed = nodes.reshape(*shape, 2), depth.reshape(shape), model.packed()

    def shade(band: Index) -> None:
        shading.shade_cells(
            int(band[0]), int(band[-1]) + 1, cells, depth, nodes, packed, origin, rotation,
            surface, skin, light, samples, out,
        )  # fmt: skip

    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(shade, np.array_split(np.arange(rows), 4 * workers)))
    _shade_mixed(cells, camera, things, origin, rotation, scene, skin, light, samples, out)
    return out


def _classify(kind: Index, depth: Array, lit: Index, projectors: int) -> NDArray[np.uint8]:
    """Sort cells by their corners: nothing seen, wheel without any edge, or to be seen sample by sample."""

    def corners(a: NDArray[Any]) -> tuple[NDArray[Any], ...]:
        return a[:-1, :-1], a[:-1, 1:], a[1:, :-1], a[1:, 1:]

    everything = (1 << projectors) - 1
    plain = np.ones((kind.shape[0] - 1, kind.shape[1] - 1), dtype=np.bool_)
    empty = plain.copy()
    for k, bits in zip(corners(kind), corners(lit), strict=True):
        plain &= (k == _WHEEL) & (bits == everything)
        empty &= k < 0
    a, b, c, d = corners(np.where(np.isfinite(depth), depth, 0.0))
    plain &= np.abs(a - b - c + d) < _TWIST * a
    # What is narrower than a cell may pass between its corners: look at the neighbours of every edge too.
    edge = ~plain & ~empty
    near = edge.copy()
    near[1:] |= edge[:-1]
    near[:-1] |= edge[1:]
    near[:, 1:] |= edge[:, :-1]
    near[:, :-1] |= edge[:, 1:]
    cells = np.where(plain, SMOOTH, NOTHING)
    return np.where(near, MIXED, cells).astype(np.uint8)


def _shade_mixed(
    cells: NDArray[np.uint8],
    camera: PosedCamera,
    things: _Things,
    origin: Array,
    rotation: Array,
    scene: WheelScene,
    skin: Skin,
    light: Light,
    samples: int,
    out: Singles,
) -> None:
    """Shade the samples of mixed cells one by one, with a ray and shadow rays of their own."""
    size = CELL * samples
    inside = np.arange(size)
    row, column = np.nonzero(cells == MIXED)
    rows = np.broadcast_to((row * size)[:, None, None] + inside[:, None], (len(row), size, size)).ravel()
    columns = np.broadcast_to((column * size)[:, None, None] + inside, (len(row), size, size)).ravel()
    kept = (rows < out.shape[0]) & (columns < out.shape[1])
    rows, columns = rows[kept], columns[kept]
    if not len(rows):
        return
    offsets = sample_offsets(samples)
    pixels = np.column_stack(
        [columns // samples + offsets[columns % samples], rows // samples + offsets[rows % samples]]
    )
    rays = np.column_stack([camera.model.normalise(pixels), np.ones(len(pixels))]) @ rotation.T
    depth, kind, normal = things.first_hit(origin, rays)
    hit = kind >= 0
    lit = np.zeros(len(rays), dtype=np.int64)
    lit[hit] = things.lit(origin + depth[hit, None] * rays[hit], light.projectors)
    wheel, other = kind == _WHEEL, kind >= _VALVE
    out[rows[wheel], columns[wheel]] = shading.shade_wheel_rays(
        rays[wheel], depth[wheel], lit[wheel], origin, scene.deformed_tyre.surface, skin, light
    )
    out[rows[other], columns[other]] = shading.shade_facets(
        rays[other], depth[other], normal[other], things.materials[kind[other]], lit[other], origin, light
    )


def light_on_chip(
    scene: WheelScene, calibration: RigCalibration, head: int, side: Literal["left", "right"]
) -> Singles:
    """Light (height, width) that one camera of a rig collects, without noise.

    The mean of all moments of a turning wheel; pose and transmission as the scene gives them.
    """
    part = calibration.heads[head]
    camera = part.left if side == "left" else part.right
    light = [
        integrate(
            render_samples(moment, camera, moment.rig_from_tyre(calibration)), SAMPLES, scene.optics.blur_px
        )
        for moment in scene.moments
    ]
    mean = light[0] if len(light) == 1 else np.mean(light, axis=0, dtype=np.float32)
    return np.asarray(mean * np.float32(scene.transmission.get(f"{part.name}.{side}", 1.0)))


def camera_image(
    scene: WheelScene,
    calibration: RigCalibration,
    head: int,
    side: Literal["left", "right"],
    rng: np.random.Generator | None,
    settings: CameraSettings | None = None,
) -> Image:
    """Image of one camera of a rig, of the light that `light_on_chip` tells; without `rng` free of noise.

    Exposure and gain of `settings` scale it; how far a wheel turns meanwhile is the scene's.
    """
    settings = settings or CameraSettings()
    light = light_on_chip(scene, calibration, head, side)
    return develop(light, scene.optics, rng, settings.exposure_ms, settings.gain_db)


def simulate_shot(
    scene: WheelScene,
    calibration: RigCalibration,
    rng: np.random.Generator,
    *,
    settings: CameraSettings | None = None,
    time_utc: datetime = SIMULATED_TIME,
    trigger_counter: int = 1,
) -> WheelShot:
    """Shoot a wheel with all cameras of a rig; each camera has noise of its own, drawn from `rng`.

    The frames' device and host times are zero: there is no clock in a rendered shot.
    """
    settings = settings or CameraSettings()
    noise = iter(rng.spawn(2 * len(calibration.heads)))

    def frame(head: int, side: Literal["left", "right"]) -> Frame:
        return Frame(
            camera=f"{calibration.rig}/{calibration.heads[head].name}/{side}",
            image=camera_image(scene, calibration, head, side, next(noise), settings),
            trigger_counter=trigger_counter,
            device_time_s=0.0,
            host_time_s=0.0,
            exposure_ms=settings.exposure_ms,
        )

    heads = tuple(
        HeadFrames(part.name, frame(index, "left"), frame(index, "right"))
        for index, part in enumerate(calibration.heads)
    )
    return WheelShot(calibration.rig, time_utc, heads)
