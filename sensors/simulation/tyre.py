"""Tyre and rim: an exact sidewall with rings and lettering, a triangle mesh for visibility, a skin.

The tyre frame has its origin in the wheel's centre, z outboard along the axis of revolution; z = 0 is near
the highest part of the sidewall. Sizes are those of a 15-inch passenger wheel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import expit, ndtr

from alignment.arrays import Array, Index, Singles
from alignment.errors import DegenerateInputError
from sensors.formats.truth import TyreLoad
from sensors.simulation import deformation
from sensors.simulation.deformation import Contact, Wobble
from sensors.simulation.lettering import STEP_MM, Inscription, relief_map
from sensors.simulation.surface import Surface, heights, occupied_blocks

PROFILE_STEP_MM = 0.05
HUB_RADIUS_MM = 60.0
TEXTURE_HALF_WIDTH_MM = 340.0
_TEXTURE_SIZE = 512
_MESH_SPOKES = 720
_MESH_STEP_MM = 1.0
_WORDS = ("TRUEWHEEL", "ROADLINE", "ALLWAY", "GRANDTOUR", "NORDWIND", "CITYROLL")
_SMALL_PRINT = (
    "195/65 R15 91H",
    "TUBELESS",
    "RADIAL",
    "OUTSIDE",
    "MAX LOAD 615 KG",
    "TREAD 4 PLIES",
    "DOT 3825",
    "MADE FOR TEST",
)


@dataclass(frozen=True)
class Material:
    """How a surface answers light.

    Attributes
    ----------
    albedo
        Share of the light that leaves diffusely (Lambert).
    gloss
        Reflectance at normal incidence of the glossy layer (Cook–Torrance, GGX, Schlick).
    roughness
        GGX α of that layer.
    """

    albedo: float
    gloss: float = 0.04
    roughness: float = 0.4


RUBBER = Material(albedo=0.06, gloss=0.04, roughness=0.38)
ALLOY = Material(albedo=0.22, gloss=0.25, roughness=0.35)
MATT = Material(albedo=0.06, gloss=0.0)
GREY = Material(albedo=0.2)


@dataclass(frozen=True)
class Ring:
    """A narrow circular ridge (groove when its height is negative) of the sidewall, millimetres."""

    radius_mm: float
    height_mm: float
    width_mm: float
    edge_mm: float = 0.25


@dataclass(frozen=True)
class Valve:
    """A valve that stands out of the rim, parallel to the axis."""

    radius_mm: float = 188.0
    angle: float = 0.0
    tip_z_mm: float = -5.0
    diameter_mm: float = 9.0


@dataclass(frozen=True, eq=False)
class Tyre:
    """One wheel's shape and skin, tyre frame.

    Attributes
    ----------
    surface
        The exact height field of sidewall and rim.
    smooth_profile
        Control values of the profile without rings, from which the mesh is made.
    rim_edge_mm
        Inside this radius the material is the rim's.
    rubber, rim
        The materials.
    letter_albedo
        Albedo of fully raised letters divided by the rubber's; 1 for letters of plain rubber.
    texture
        (T, T) factors of the albedo over x, y = ±`TEXTURE_HALF_WIDTH_MM`; row over y, column over x.
    valve
        None for a wheel without one.
    """

    surface: Surface
    smooth_profile: Array
    rim_edge_mm: float
    rubber: Material
    rim: Material
    letter_albedo: float
    texture: Singles
    valve: Valve | None = None

    @property
    def outer_radius_mm(self) -> float:
        """Largest radius of the height field; the tread turns away from the cameras there."""
        return HUB_RADIUS_MM + (len(self.surface.profile) - 3) * PROFILE_STEP_MM

    @property
    def outermost_mm(self) -> float:
        """Height of the outermost ring of the sidewall in the air, where its section width is taken.

        Ridges and letters do not count: the section width of UN Regulation 30 leaves out elevations by
        marking, decoration and protective ribs.
        """
        first = round((self.rim_edge_mm - HUB_RADIUS_MM) / PROFILE_STEP_MM)
        knots = self.smooth_profile
        return float((knots[:-2] + 4.0 * knots[1:-1] + knots[2:])[first - 1 :].max() / 6.0)

    def height(self, xy: Array) -> tuple[Array, Array]:
        """Exact heights (N,) and gradients (N, 2) at points (N, 2) of the tyre frame, millimetres.

        Raises
        ------
        DegenerateInputError
            When a point is not on the tyre.
        """
        s = self.surface
        places = np.ascontiguousarray(xy, dtype=np.float64)
        values, inside = heights(places, s.scales, s.profile, s.relief, s.deformation)
        if not inside.all():
            raise DegenerateInputError(
                field="xy",
                expected=f"radii between {HUB_RADIUS_MM:g} and {self.outer_radius_mm:g} mm",
                seen=f"{int((~inside).sum())} points elsewhere",
            )
        return values[:, 0], values[:, 1:3]

    def with_dirt(self, rng: np.random.Generator, patches: int, strength: float = 0.6) -> Tyre:
        """Return the same tyre with dust (bright) and wet spots (dark) of 10 to 60 mm on its sidewall."""
        texture = self.texture.copy()
        axis = np.linspace(-TEXTURE_HALF_WIDTH_MM, TEXTURE_HALF_WIDTH_MM, _TEXTURE_SIZE, dtype=np.float32)
        for _ in range(patches):
            angle, radius = rng.uniform(0, 2 * math.pi), rng.uniform(self.rim_edge_mm, self.outer_radius_mm)
            size = rng.uniform(5.0, 30.0)
            x, y = radius * math.cos(angle), radius * math.sin(angle)
            distance = np.hypot(axis[None, :] - x, axis[:, None] - y)
            inside = expit((size - distance) / (0.15 * size))
            texture *= 1.0 + inside * np.float32(rng.choice([-1.0, 1.5]) * strength)
        return replace(self, texture=texture)

    def deformed(
        self,
        load: tuple[TyreLoad, Contact] | None,
        wobble: Wobble | None = None,
        lean: tuple[float, float] = (0.0, 0.0),
    ) -> Tyre:
        """Return the same tyre as load and wobble deform it; arguments as `deformation.control_values`."""
        first, step = self.surface.scales[4:6]
        values = deformation.control_values(
            self.rim_edge_mm, first, self.outer_radius_mm + step, load=load, wobble=wobble, lean=lean
        )
        return replace(self, surface=self.surface._replace(deformation=values))

    @cached_property
    def scene(self) -> Any:
        """Open3D ray-casting scene, tyre frame: geometry 0 the wheel (no rings, no letters), 1 the valve."""
        return casting_scene(self._meshes())

    def _meshes(self) -> list[tuple[Array, Index]]:
        radii = np.arange(HUB_RADIUS_MM + 2 * PROFILE_STEP_MM, self.outer_radius_mm, _MESH_STEP_MM)
        radii = np.append(radii, self.outer_radius_mm)
        knots = HUB_RADIUS_MM + PROFILE_STEP_MM * np.arange(len(self.smooth_profile))
        z = np.interp(radii, knots, self.smooth_profile)
        # The tread: away from the cameras, so that nothing behind the tyre shines through.
        outline = np.column_stack([np.append(radii, radii[-1]), np.append(z, z[-1] - 150.0)])
        vertices, triangles = lathe(outline, _MESH_SPOKES)
        if self.surface.deformation is not None:
            vertices = deformation.displaced(vertices, self.surface.deformation, self.surface.scales[4])
        meshes = [(vertices, triangles)]
        if self.valve is not None:
            v = self.valve
            half = v.diameter_mm / 2
            stem = np.array(
                [[half, v.tip_z_mm - 60.0], [half, v.tip_z_mm - 1], [half - 1, v.tip_z_mm], [0, v.tip_z_mm]]
            )
            vertices, triangles = lathe(stem, 24)
            place = np.array([v.radius_mm * math.cos(v.angle), v.radius_mm * math.sin(v.angle), 0.0])
            meshes.append((vertices + place, triangles))
        return meshes


def casting_scene(meshes: Sequence[tuple[Array, Index]]) -> Any:
    """Open3D ray-casting scene of meshes (vertices, triangles), whose geometry ids count from 0."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    for vertices, triangles in meshes:
        scene.add_triangles(tensor(vertices, np.float32), tensor(triangles, np.uint32))
    return scene


def tensor(array: NDArray[Any], kind: type[np.generic]) -> Any:
    """Copy an array to an Open3D tensor of a NumPy type."""
    import open3d as o3d

    make: Any = o3d.core.Tensor  # its stubs do not know that one argument is enough
    return make(np.ascontiguousarray(array, dtype=kind))


def lathe(outline: Array, spokes: int) -> tuple[Array, Index]:
    """Turn an outline (N, 2) of (radius, z) about the z axis: vertices (M, 3) and triangles (K, 3)."""
    angle = 2 * math.pi * np.arange(spokes) / spokes
    n = len(outline)
    vertices = np.stack(
        [
            np.outer(np.cos(angle), outline[:, 0]),
            np.outer(np.sin(angle), outline[:, 0]),
            np.broadcast_to(outline[:, 1], (spokes, n)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    here = np.arange(spokes)[:, None] * n + np.arange(n - 1)
    there = np.roll(here, -1, axis=0)
    triangles = np.concatenate(
        [
            np.stack([here, here + 1, there], axis=-1).reshape(-1, 3),
            np.stack([here + 1, there + 1, there], axis=-1).reshape(-1, 3),
        ]
    )
    return vertices, triangles


@dataclass(frozen=True)
class TyreShape:
    """The form of a sidewall, millimetres; `draw_tyre` varies it a little.

    Attributes
    ----------
    rim_edge
        Radius where the rubber begins.
    crest, crest_z
        Radius and height of the highest part.
    outer
        Outer radius of the height field.
    drop_inside, drop_outside
        How far the sidewall falls from the crest to the rim edge and to the shoulder.
    rings
        How many narrow ridges and grooves.
    letters
        Height of the large letters; 0 for a tyre without lettering.
    """

    rim_edge: float
    crest: float
    crest_z: float
    outer: float
    drop_inside: float
    drop_outside: float
    rings: int
    letters: float


SHAPES = {
    "touring": TyreShape(204.0, 262.0, 4.0, 319.0, 20.0, 18.0, 6, 15.0),
    "sport": TyreShape(214.0, 244.0, -2.0, 312.0, 7.0, 14.0, 9, 10.0),
    "van": TyreShape(200.0, 270.0, 8.0, 324.0, 26.0, 12.0, 4, 20.0),
}
"""Shapes by name, among which the accuracy studies draw."""

MADE_SHAPES = {**SHAPES, "low_profile": TyreShape(240.0, 276.0, 0.0, 321.0, 6.0, 11.0, 5, 8.0)}
"""All shapes that `draw_tyre` knows by name."""


def _smooth_profile(shape: TyreShape, radii: Array) -> Array:
    """Sidewall without rings, shoulder, rim lip and dish."""
    inward = np.clip((shape.crest - radii) / (shape.crest - shape.rim_edge), 0.0, 1.0)
    outward = np.clip((radii - shape.crest) / (shape.outer - shape.crest), 0.0, None)
    z = np.full_like(radii, shape.crest_z)
    z -= shape.drop_inside * (0.65 * inward**2 + 0.35 * inward**4)
    z -= shape.drop_outside * (0.65 * outward**2 + 0.35 * outward**4)
    z -= 0.22 * np.clip(radii - (shape.outer - 7.0), 0.0, None) ** 2
    lip = shape.rim_edge - 7.0
    z += 6.0 * np.exp(-(((radii - lip) / 3.5) ** 2))
    into = np.clip((lip - 3.0 - radii) / 18.0, 0.0, 1.0)
    z -= 48.0 * into**2 * (3.0 - 2.0 * into)
    z += 25.0 * np.clip(1.0 - radii / (lip - 21.0), 0.0, 1.0)
    return np.asarray(gaussian_filter1d(z, 0.8 / PROFILE_STEP_MM, mode="nearest"))


def make_tyre(
    shape: TyreShape,
    rings: Sequence[Ring] = (),
    inscriptions: Sequence[Inscription] = (),
    *,
    texture: Singles | None = None,
    rubber: Material = RUBBER,
    rim: Material = ALLOY,
    letter_albedo: float = 1.0,
    valve: Valve | None = None,
) -> Tyre:
    """Build a tyre from its parts; without `texture` the albedo is even."""
    count = round((shape.outer - HUB_RADIUS_MM) / PROFILE_STEP_MM) + 3
    radii: Array = HUB_RADIUS_MM + PROFILE_STEP_MM * np.arange(count, dtype=np.float64)
    smooth = _smooth_profile(shape, radii)
    profile = smooth.copy()
    for ring in rings:
        outer_flank = (radii - ring.radius_mm - ring.width_mm / 2) / ring.edge_mm
        inner_flank = (radii - ring.radius_mm + ring.width_mm / 2) / ring.edge_mm
        profile += ring.height_mm * (ndtr(inner_flank) - ndtr(outer_flank))
    inner, outer = shape.rim_edge + 3.0, shape.outer - 6.0
    relief = relief_map(inscriptions, inner, outer) if inscriptions else np.zeros((4, 8), dtype=np.float32)
    scales = np.array(
        [
            HUB_RADIUS_MM,
            PROFILE_STEP_MM,
            inner,
            STEP_MM,
            HUB_RADIUS_MM - 2 * deformation.ROW_STEP_MM,
            deformation.ROW_STEP_MM,
        ]
    )
    surface = Surface(scales, profile, relief, occupied_blocks(relief))
    if texture is None:
        texture = np.ones((_TEXTURE_SIZE, _TEXTURE_SIZE), dtype=np.float32)
    return Tyre(surface, smooth, shape.rim_edge, rubber, rim, letter_albedo, texture, valve)


def _draw_texture(rng: np.random.Generator, variation: float) -> Singles:
    texture = np.ones((_TEXTURE_SIZE, _TEXTURE_SIZE), dtype=np.float32)
    for sigma, share in ((1.0, 0.5), (6.0, 0.5), (40.0, 1.0)):
        noise = cv2.GaussianBlur(rng.standard_normal(texture.shape, dtype=np.float32), (0, 0), sigma)
        texture += np.float32(variation * share) * noise / noise.std()
    return np.asarray(np.clip(texture, 0.3, 2.0), dtype=np.float32)


def draw_tyre(
    rng: np.random.Generator, shape: str | TyreShape = "touring", *, letter_albedo: float = 1.0
) -> Tyre:
    """Draw a tyre of one of `MADE_SHAPES`: form within some millimetres, rings, lettering and skin at random.

    Raises
    ------
    DegenerateInputError
        When `shape` names none.
    """
    if isinstance(shape, str):
        if shape not in MADE_SHAPES:
            raise DegenerateInputError(field="shape", expected=" or ".join(MADE_SHAPES), seen=f"'{shape}'")
        shape = MADE_SHAPES[shape]
    shape = replace(
        shape,
        crest=shape.crest + rng.uniform(-5.0, 5.0),
        crest_z=shape.crest_z + rng.uniform(-2.0, 2.0),
        drop_inside=shape.drop_inside * rng.uniform(0.85, 1.15),
        drop_outside=shape.drop_outside * rng.uniform(0.85, 1.15),
    )
    inside, outside = shape.rim_edge + 8.0, shape.outer - 12.0
    rings = [
        Ring(
            radius_mm=radius + rng.uniform(-2.0, 2.0),
            height_mm=float(rng.choice([-1.0, 1.0])) * rng.uniform(0.3, 1.0),
            width_mm=rng.uniform(1.0, 3.5),
            edge_mm=rng.uniform(0.3, 0.7),
        )
        for radius in np.linspace(inside, outside, shape.rings)
    ]
    return make_tyre(
        shape,
        rings,
        _draw_inscriptions(rng, shape) if shape.letters else (),
        texture=_draw_texture(rng, 0.05),
        letter_albedo=letter_albedo,
        valve=Valve(radius_mm=shape.rim_edge - 17.0, angle=rng.uniform(-math.pi, math.pi)),
    )


def _draw_inscriptions(rng: np.random.Generator, shape: TyreShape) -> list[Inscription]:
    """Three or four large words and a ring of small print on each side of them."""
    sidewall = shape.outer - shape.rim_edge
    turn = rng.uniform(0.0, 2 * math.pi)
    count = int(rng.integers(3, 5))
    large = [
        Inscription(
            text=str(rng.choice(_WORDS)),
            radius_mm=shape.rim_edge + 0.52 * sidewall,
            angle=turn + 2 * math.pi * i / count,
            size_mm=shape.letters,
            relief_mm=rng.uniform(0.4, 0.8),
        )
        for i in range(count)
    ]
    small = [
        Inscription(
            text=str(rng.choice(_SMALL_PRINT)),
            radius_mm=shape.rim_edge + place * sidewall,
            angle=turn + rng.uniform(0.0, 0.2) + 2 * math.pi * i / 8,
            size_mm=rng.uniform(4.0, 7.0),
            relief_mm=rng.uniform(0.3, 0.5),
        )
        for place in (0.26, 0.76)
        for i in range(8)
    ]
    return large + small
