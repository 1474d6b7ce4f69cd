"""Compiled kernels that turn ray hits into radiance; all positions in the tyre frame, millimetres.

Reflection is Lambert's, with a glossy layer after Cook–Torrance (GGX distribution, Schlick's Fresnel term,
Kelemen's visibility term). Left out: light that bounces between surfaces, and colour.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alignment.arrays import Array, Index, Mask, Singles
from alignment.geometry import unproject_pixel
from sensors.simulation.projector import irradiance, may_light
from sensors.simulation.surface import Surface, height, kernel, meet_surface, part, relief_near

CELL = 4
NOTHING, SMOOTH, MIXED = 0, 1, 2
_RELIEF_SLOPE = 5e-4  # how far two millimetres of relief shift the light, as a projector sees it
_LETTER_MM = 0.3  # a letter has its full colour from this height on


class Skin(NamedTuple):
    """What the kernels read of a wheel's materials.

    Attributes
    ----------
    texture
        (T, T) factors of the albedo.
    materials
        (9,) half width of the texture, radius of the rim edge, albedo of letters over rubber; albedo, gloss
        and roughness of the rubber; the same of the rim.
    """

    texture: Singles
    materials: Array


class Light(NamedTuple):
    """All light of a scene.

    Attributes
    ----------
    projectors
        (n, PACKED) packed projectors.
    lines
        (n, 2, m) brightness of their lines.
    around
        (9,) ambient level; direction towards the sun, a point on the axis of its beam, its radius, its level;
        level 0 stands for no sun.
    """

    projectors: Array
    lines: Array
    around: Array


@part
def _wheel_material(
    x: float, y: float, bump: float, texture: Singles, materials: Array
) -> tuple[float, float, float]:
    n = texture.shape[0]
    scale, last = (n - 1) / (2.0 * materials[0]), n - 1.001
    u = min(max((x + materials[0]) * scale, 0.0), last)
    v = min(max((y + materials[0]) * scale, 0.0), last)
    i, j = int(v), int(u)
    f, g = v - i, u - j
    upper = texture[i, j] * (1.0 - g) + texture[i, j + 1] * g
    lower = texture[i + 1, j] * (1.0 - g) + texture[i + 1, j + 1] * g
    factor = upper * (1.0 - f) + lower * f
    if x * x + y * y < materials[1] * materials[1]:
        return materials[6] * factor, materials[7], materials[8]
    factor *= 1.0 + (materials[2] - 1.0) * min(max(bump / _LETTER_MM, 0.0), 1.0)
    return materials[3] * factor, materials[4], materials[5]


@part
def _reflect(
    nx: float, ny: float, nz: float, vx: float, vy: float, vz: float,
    lx: float, ly: float, lz: float, albedo: float, gloss: float, roughness: float,
) -> float:  # fmt: skip
    """Share of the irradiance from unit direction l that leaves towards unit direction v."""
    cosine = nx * lx + ny * ly + nz * lz
    if cosine <= 0.0:
        return 0.0
    value = albedo
    if gloss > 0.0:
        hx, hy, hz = lx + vx, ly + vy, lz + vz
        length = math.sqrt(hx * hx + hy * hy + hz * hz)
        nh = (nx * hx + ny * hy + nz * hz) / length
        lh = max((lx * hx + ly * hy + lz * hz) / length, 0.1)
        a2 = roughness * roughness
        d = nh * nh * (a2 - 1.0) + 1.0
        m = 1.0 - lh
        fresnel = gloss + (1.0 - gloss) * m * m * m * m * m
        # π cancels between the distribution and the irradiance of a white Lambertian surface.
        value += a2 / (d * d) * fresnel / (4.0 * lh * lh)
    return value * cosine


@part
def _radiance(
    x: float, y: float, z: float, nx: float, ny: float, nz: float, vx: float, vy: float, vz: float,
    albedo: float, gloss: float, roughness: float, unshadowed: int,
    projectors: Array, lines: Array, around: Array,
) -> float:  # fmt: skip
    total: float = albedo * around[0] * (0.5 + 0.5 * nz)
    for k in range(projectors.shape[0]):
        if (unshadowed >> k) & 1:
            e = irradiance(x, y, z, k, projectors, lines)
            if e > 0.0:
                lx, ly, lz = projectors[k, 0] - x, projectors[k, 1] - y, projectors[k, 2] - z
                w = 1.0 / math.sqrt(lx * lx + ly * ly + lz * lz)
                total += e * _reflect(
                    nx, ny, nz, vx, vy, vz, lx * w, ly * w, lz * w, albedo, gloss, roughness
                )
    if around[8] > 0.0:
        sx, sy, sz = around[1], around[2], around[3]
        dx, dy, dz = x - around[4], y - around[5], z - around[6]
        along = dx * sx + dy * sy + dz * sz
        off = math.sqrt(max(dx * dx + dy * dy + dz * dz - along * along, 0.0))
        e = around[8] / (1.0 + math.exp(min((off / around[7] - 1.0) * 20.0, 50.0)))
        total += e * _reflect(nx, ny, nz, vx, vy, vz, sx, sy, sz, albedo, gloss, roughness)
    return total


@part
def _wheel_radiance(
    x: float, y: float, z: float, dx: float, dy: float, dz: float, zx: float, zy: float, bump: float,
    unshadowed: int, texture: Singles, materials: Array,
    projectors: Array, lines: Array, around: Array,
) -> float:  # fmt: skip
    albedo, gloss, roughness = _wheel_material(x, y, bump, texture, materials)
    n = 1.0 / math.sqrt(1.0 + zx * zx + zy * zy)
    v = -1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
    return _radiance(
        x, y, z, -zx * n, -zy * n, n, dx * v, dy * v, dz * v,
        albedo, gloss, roughness, unshadowed, projectors, lines, around,
    )  # fmt: skip


@kernel
def _meet_letters(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t: float,
    scales: Array, profile: Array, relief: Singles, deformation: Array | None,
) -> tuple[float, float, float, float, bool]:  # fmt: skip
    """`meet_surface` where letters are; a call of its own, so that the many samples without stay lean."""
    return meet_surface(ox, oy, oz, dx, dy, dz, t, scales, profile, relief, deformation, True)


@kernel
def shade_cells(
    first: int, last: int, kind: NDArray[np.uint8], depth: Array, nodes: Array, camera: Array,
    o: Array, R: Array, surface: Surface, skin: Skin, light: Light, samples: int,
    out: Singles,
) -> None:  # fmt: skip
    """Shade the smooth cells of cell rows first..last−1.

    Cells that only ambient light reaches are sampled once for two by two pixels: there are no lines in it.

    Parameters
    ----------
    kind
        (rows, columns) of the cells.
    depth, nodes
        (rows + 1, columns + 1) camera depth t and (…, 2) normalised coordinates at the cells' corners.
    camera
        Packed camera model.
    o, R
        Centre of the camera and rotation to the tyre frame.
    out
        (samples · height, samples · width) radiance; other cells stay untouched.
    """
    scales, profile, relief, occupied = surface.scales, surface.profile, surface.relief, surface.occupied
    deformation = surface.deformation
    texture, materials = skin.texture, skin.materials
    projectors, lines, around = light.projectors, light.lines, light.around
    ox, oy, oz = o[0], o[1], o[2]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = (
        R[0, 0], R[0, 1], R[0, 2], R[1, 0], R[1, 1], R[1, 2], R[2, 0], R[2, 1], R[2, 2],
    )  # fmt: skip
    height_px, width_px = out.shape[0] // samples, out.shape[1] // samples
    corners, above = np.empty((4, 3)), np.empty(CELL * samples)
    for i in range(first, last):
        for j in range(kind.shape[1]):
            if kind[i, j] != SMOOTH:
                continue
            for c in range(4):
                a, b = i + c // 2, j + c % 2
                x, y, t = nodes[a, b, 0], nodes[a, b, 1], depth[a, b]
                corners[c, 0] = ox + t * (r00 * x + r01 * y + r02)
                corners[c, 1] = oy + t * (r10 * x + r11 * y + r12)
                corners[c, 2] = oz + t * (r20 * x + r21 * y + r22)
            falls = 0
            for k in range(projectors.shape[0]):
                if may_light(corners, _RELIEF_SLOPE, k, projectors):
                    falls |= 1 << k
            inner, outer = 1e18, 0.0
            for c in range(4):
                r2 = corners[c, 0] * corners[c, 0] + corners[c, 1] * corners[c, 1]
                inner, outer = min(inner, r2), max(outer, r2)
            at_rim_edge = inner <= materials[1] * materials[1] <= outer
            fine = falls != 0 or around[8] > 0.0 or at_rim_edge
            mx, my = 0.5 * (corners[0, 0] + corners[3, 0]), 0.5 * (corners[0, 1] + corners[3, 1])
            bumpy = relief_near(mx, my, 1.0, scales, relief, occupied)

            x0, y0 = nodes[i, j, 0], nodes[i, j, 1]
            xu, yu = (nodes[i, j + 1, 0] - x0) / CELL, (nodes[i, j + 1, 1] - y0) / CELL
            xv, yv = (nodes[i + 1, j, 0] - x0) / CELL, (nodes[i + 1, j, 1] - y0) / CELL
            t00, tu, tv = depth[i, j], depth[i, j + 1] - depth[i, j], depth[i + 1, j] - depth[i, j]
            tuv = depth[i + 1, j + 1] - depth[i, j] - tu - tv
            top, left = CELL * i, CELL * j
            bottom, right = min(top + CELL, height_px), min(left + CELL, width_px)
            if not fine:
                for row in range(top, bottom, 2):
                    for column in range(left, right, 2):
                        v, u = row - top + 1.0, column - left + 1.0
                        x, y = x0 + u * xu + v * xv, y0 + u * yu + v * yv
                        f, g = v / CELL, u / CELL
                        t = t00 + g * tu + f * (tv + g * tuv)
                        dx, dy, dz = (
                            r00 * x + r01 * y + r02, r10 * x + r11 * y + r12, r20 * x + r21 * y + r22,
                        )  # fmt: skip
                        x, y = ox + t * dx, oy + t * dy
                        z, zx, zy, bump, _ = height(x, y, scales, profile, relief, deformation, bumpy)
                        value = _wheel_radiance(
                            x, y, z, dx, dy, dz, zx, zy, bump, 0,
                            texture, materials, projectors, lines, around,
                        )  # fmt: skip
                        for a in range(row * samples, min(row + 2, bottom) * samples):
                            for b in range(column * samples, min(column + 2, right) * samples):
                                out[a, b] = value
                continue
            # A cell's rays bend by a parabola each way: exact to a hundred-thousandth of a pixel.
            xh, yh, _ = unproject_pixel(left - 0.5 + 0.5 * CELL, top - 0.5, camera)
            bxu, byu = 4.0 * (xh - x0) - 2.0 * CELL * xu, 4.0 * (yh - y0) - 2.0 * CELL * yu
            xh, yh, _ = unproject_pixel(left - 0.5, top - 0.5 + 0.5 * CELL, camera)
            bxv, byv = 4.0 * (xh - x0) - 2.0 * CELL * xv, 4.0 * (yh - y0) - 2.0 * CELL * yv
            xuv = nodes[i + 1, j + 1, 0] - x0 - CELL * (xu + xv)
            yuv = nodes[i + 1, j + 1, 1] - y0 - CELL * (yu + yv)
            # Lift of the surface above the interpolated depth: of rings and letters, which the mesh lacks.
            # Foretold from three neighbours; mostly one step of Newton's method then does.
            above[:] = 0.0
            for a in range((bottom - top) * samples):
                f = (a + 0.5) / (CELL * samples)
                before, lift = above[0], 0.0
                for b in range((right - left) * samples):
                    g = (b + 0.5) / (CELL * samples)
                    x = x0 + g * (CELL * xu + f * xuv + (1.0 - g) * bxu) + f * (CELL * xv + (1.0 - f) * bxv)
                    y = y0 + g * (CELL * yu + f * yuv + (1.0 - g) * byu) + f * (CELL * yv + (1.0 - f) * byv)
                    dx, dy, dz = (
                        r00 * x + r01 * y + r02, r10 * x + r11 * y + r12, r20 * x + r21 * y + r22,
                    )  # fmt: skip
                    guess = t00 + g * tu + f * (tv + g * tuv)
                    foretold = above[b] if b == 0 else above[b] + lift - before
                    if bumpy:
                        t, zx, zy, bump, ok = _meet_letters(
                            ox, oy, oz, dx, dy, dz, guess + foretold, scales, profile, relief, deformation
                        )
                    else:
                        t, zx, zy, bump, ok = meet_surface(
                            ox, oy, oz, dx, dy, dz, guess + foretold,
                            scales, profile, relief, deformation, False,
                        )  # fmt: skip
                    lift = t - guess if ok else 0.0
                    before, above[b] = above[b], lift
                    out[top * samples + a, left * samples + b] = _wheel_radiance(
                        ox + t * dx, oy + t * dy, oz + t * dz, dx, dy, dz, zx, zy, bump,
                        falls if ok else 0, texture, materials, projectors, lines, around,
                    )  # fmt: skip


@kernel
def refine(rays: Array, t: Array, o: Array, surface: Surface) -> tuple[Array, Array, Mask]:
    """Exact hits of rays (N, 3) from o near t (N,): t (N,), rows (dz/dx, dz/dy, relief), and success."""
    scales, profile, relief, deformation = (
        surface.scales,
        surface.profile,
        surface.relief,
        surface.deformation,
    )
    out, gradient = np.empty_like(t), np.empty_like(rays)
    good = np.empty(t.shape[0], dtype=np.bool_)
    for i in range(t.shape[0]):
        out[i], gradient[i, 0], gradient[i, 1], gradient[i, 2], good[i] = meet_surface(
            o[0], o[1], o[2], rays[i, 0], rays[i, 1], rays[i, 2], t[i],
            scales, profile, relief, deformation, True,
        )  # fmt: skip
    return out, gradient, good


@kernel
def shade_wheel_rays(
    rays: Array, t: Array, unshadowed: Index, o: Array, surface: Surface, skin: Skin, light: Light
) -> Array:
    """Radiance (N,) of single rays (N, 3) that hit the wheel near t; bit k of `unshadowed` is projector k."""
    hits, gradient, good = refine(rays, t, o, surface)
    texture, materials = skin.texture, skin.materials
    projectors, lines, around = light.projectors, light.lines, light.around
    out = np.empty(t.shape[0])
    for i in range(t.shape[0]):
        dx, dy, dz, depth = rays[i, 0], rays[i, 1], rays[i, 2], hits[i]
        # A hit that cannot be refined lies on the tread or where the surface turns away: ambient light only.
        out[i] = _wheel_radiance(
            o[0] + depth * dx, o[1] + depth * dy, o[2] + depth * dz, dx, dy, dz,
            gradient[i, 0], gradient[i, 1], gradient[i, 2], unshadowed[i] if good[i] else 0,
            texture, materials, projectors, lines, around,
        )  # fmt: skip
    return out


@kernel
def shade_facets(
    rays: Array,
    t: Array,
    normals: Array,
    materials: Array,
    unshadowed: Index,
    o: Array,
    light: Light,
) -> Array:
    """Radiance (N,) of rays (N, 3) that hit plain triangles at t, with unit normals and materials (N, 3)."""
    projectors, lines, around = light.projectors, light.lines, light.around
    out = np.empty(t.shape[0])
    for i in range(t.shape[0]):
        dx, dy, dz = rays[i, 0], rays[i, 1], rays[i, 2]
        v = -1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if nx * dx + ny * dy + nz * dz > 0.0:
            nx, ny, nz = -nx, -ny, -nz
        out[i] = _radiance(
            o[0] + t[i] * dx, o[1] + t[i] * dy, o[2] + t[i] * dz, nx, ny, nz, dx * v, dy * v, dz * v,
            materials[i, 0], materials[i, 1], materials[i, 2], unshadowed[i], projectors, lines, around,
        )  # fmt: skip
    return out
