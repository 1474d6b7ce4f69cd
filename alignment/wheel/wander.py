"""The cone of a wheel whose axis wanders slowly while it turns: mean axis, run-out, and the way of the axis.

The normal of exposure k is `mean + way(k) + run-out towards phase(k)`. The way is a Gaussian process
without anything faster than half a swing per turn (kernel sinc), clocked by the turn itself, since nobody
tells when an exposure was taken; its sample mean is zero, so that the mean is that of the exposures. Of its
size and of the noise beside the stated one a small grid is averaged by its evidence (Rasmussen and
Williams, Gaussian Processes for Machine Learning, ch. 2 and 5; flat prior of the mean axis, so the evidence
is the restricted likelihood).

A tyre that is no plane, by a second harmonic of its run-out, leans before the heads twice per turn as well.
Three even heads see it lean against the turn, which is told from an axis; what leans with the turn is not, as
long as phases are free. Where cone and way leave more than noise, such a lean, as the places of the heads
make it, is one more hypothesis.

Two ways to see it. A *steady* turn, the same angle from one exposure to the next, makes the problem linear
and finds turn and run-out from nothing; what the turn is not steady by looks like noise in proportion to
the run-out. A *free* phase of every exposure leaves only distances from the axis to tell, exact however the
wheel turned, but wants a run-out that stands clear of the way. The first starts the second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from alignment.arrays import Array
from alignment.units import ARCMIN

_FASTEST = 0.5  # swings of the way per turn
_WAYS = ARCMIN * np.array([0.0, 0.05, 0.2, 0.7, 2.1])  # standard deviations along one direction
_LEAST_NOISE = 0.008 * ARCMIN  # letters turn with the wheel, and are in no stated noise
_NOISES = np.array([1.0, 1.5, 2.3, 3.5, 5.0])  # in stated noise
_IRREGULAR = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 40.0])  # the same of a steady turn, which may be uneven
_STEPS = np.arange(0.1, math.pi, 0.08)  # turns between two exposures that are tried, radians
_FINER = np.linspace(-0.06, 0.06, 7)
_STILL = 2.5  # turns in the time of all exposures that clock the way of a wheel without run-out
_LARGEST = math.radians(5.0)
_PRIOR = math.log((30.0 * ARCMIN) ** 2)  # run-outs up to about 30′ are to be expected
_EVEN: Array = 2.0 * math.pi / 3.0 * np.arange(3, dtype=np.float64)
_CLEAR_OF_WAY = 1.3  # run-out in largest distances of the way from its mean, from which phases can be free
_ITERATIONS, _SETTLED = 60, 1e-4 * ARCMIN
_NO_HARMONIC = np.zeros(1)
_HARMONICS = ARCMIN * np.array([0.0, 0.3, 1.0, 3.0])  # leans twice per turn, one standard deviation
_WITH_TURN = 0.1  # of such a lean, that may go with the turn though heads stand evenly: they see patches
_UNEXPLAINED = 2.0  # of the noise, that cone and way leave, from which such a lean is looked for


@dataclass(frozen=True, eq=False)
class WanderingCone:
    """What the points of a scatter say of a wandering cone.

    Attributes
    ----------
    centre
        (2,) mean axis.
    radius
        Run-out, radians; 0 where none is told from way and noise.
    way
        (N, 2) axis of each exposure less the mean.
    phases
        (N,) where the tyre plane's normal leans to at each exposure, radians, growing or falling steadily as
        the wheel turned; what turns are between two exposures beyond half a one stays unknown.
    free
        Whether the phases are free, so that how steadily the wheel turned does not matter.
    covariance
        (3, 3) of centre and radius.
    across
        (N,) variance of each exposure's axis across the lean, radians²: what its phase does not know.
    rest
        Root mean square of what is neither cone nor way along one direction, radians.
    twice
        (N, 2) what leans twice per turn; nothing where none was looked for.
    """

    centre: Array
    radius: float
    way: Array
    phases: Array
    free: bool
    covariance: Array
    across: Array
    rest: float
    twice: Array

    @property
    def farthest(self) -> float:
        """Largest distance of the way from its mean, radians."""
        return float(np.linalg.norm(self.way, axis=1).max())


def fit_wandering_cone(
    points: Array, noise: Array, numbers: Array, heads: Array | None = None
) -> WanderingCone:
    """Fit the cone to at least twelve normals.

    Parameters
    ----------
    points
        (N, 2) normals as angles from near the axis, radians: a plane takes the place of the sphere.
    noise
        (N, 2, 2) covariance of each.
    numbers
        (N,) when each was taken, in exposures; a gap stands for one that is left out.
    heads
        (H,) where the heads look at the wheel, radians, counted as phases; None: three evenly.
    """
    noise = noise + _LEAST_NOISE**2 * np.eye(2)
    sigma = math.sqrt(float(np.median(np.trace(noise, axis1=1, axis2=2))) / 2.0)
    start = _steady(points, sigma, numbers)
    if start.radius <= max(_CLEAR_OF_WAY * start.farthest, 5.0 * sigma):
        return start
    found = _free(points, noise, numbers, start, _NO_HARMONIC) or start
    if found.rest <= _UNEXPLAINED * sigma:
        return found
    gains = _gains(_EVEN if heads is None else heads)
    return _free(points, noise, numbers, start, _HARMONICS, gains) or found


def _kernel(turns: Array) -> Array:
    """(…, N, N) covariance of a way of unit size without its mean, at these turns (…, N)."""
    count = turns.shape[-1]
    centred = np.eye(count) - 1.0 / count
    apart = turns[..., :, None] - turns[..., None, :]
    out: Array = centred @ np.sinc(2.0 * _FASTEST * apart) @ centred
    return out


def _steady(points: Array, sigma: float, numbers: Array) -> WanderingCone:
    """See the wheel turn by one angle from each exposure to the next; points are complex numbers."""
    z = points[:, 0] + 1j * points[:, 1]
    coarse = np.concatenate([_STEPS, -_STEPS])
    rough = max(2.0 * sigma, 0.06 * float(np.std(z)))
    scan = _turning(z, numbers, coarse, np.array([_WAYS[-1]]), np.array([rough]))
    best = coarse[int(scan[0].argmax())]
    steps = best + _FINER
    steps = steps[np.abs(steps) > 0.5 * _STEPS[0]]
    turning = _turning(z, numbers, steps, _WAYS, sigma * _IRREGULAR)
    still = _turning(z, numbers, None, _WAYS, sigma * _IRREGULAR)
    # The flat prior of a run-out has a size, and only a few of the steps that were tried are like the best.
    gain = _log_mean(turning[0]) + math.log(len(_FINER) / len(coarse)) - _PRIOR - _log_mean(still[0])
    return _averaged(still if gain < 0.0 else turning, points, sigma, numbers)


_Hypotheses = tuple[Array, Array, Array, Array, Array, Array]


def _turning(z: Array, numbers: Array, steps: Array | None, ways: Array, noises: Array) -> _Hypotheses:
    """Weigh hypotheses: every step with every size of way and noise; without steps the wheel has no run-out.

    Returns evidences (M,), centre and run-out as complex numbers (M, 2), their covariances (M, 2, 2) of real
    and imaginary part together, ways (M, N), rests (M, N), and steps (M,).
    """
    count = len(z)
    numbers = numbers - numbers.mean()
    # Without a turn to clock it the way makes a few swings in the whole series.
    asked = np.array([2.0 * math.pi * _STILL / count]) if steps is None else steps
    step, way, noise = (a.ravel() for a in np.meshgrid(asked, ways, noises, indexing="ij"))
    each = len(ways) * len(noises)
    kernel = np.repeat(_kernel(np.abs(asked)[:, None] * numbers / (2.0 * math.pi)), each, axis=0)
    total = (way**2)[:, None, None] * kernel + (noise**2)[:, None, None] * np.eye(count)
    turned = np.exp(1j * step[:, None] * numbers)
    design = np.stack([np.ones_like(turned), turned], axis=-1)[:, :, : 1 if steps is None else 2]
    right = np.concatenate([design, np.broadcast_to(z[:, None], (len(step), count, 1))], axis=-1)
    solved = np.linalg.solve(total, right)
    adjoint = np.conj(np.swapaxes(design, 1, 2))
    information = adjoint @ solved[:, :, :-1]
    covariance = np.linalg.inv(information)
    values = covariance @ adjoint @ solved[:, :, -1:]
    weighted = solved[:, :, -1] - (solved[:, :, :-1] @ values)[:, :, 0]
    square = (np.conj(z) * weighted).sum(axis=1).real
    evidence = -(np.linalg.slogdet(total)[1] + np.linalg.slogdet(information)[1] + square)
    moved = (way**2)[:, None] * np.einsum("mij,mj->mi", kernel, weighted)
    return evidence, values[:, :, 0], covariance, moved, (noise**2)[:, None] * weighted, step


def _averaged(found: _Hypotheses, points: Array, sigma: float, numbers: Array) -> WanderingCone:
    """Average hypotheses by their evidence."""
    evidence, values, covariance, ways, rests, steps = found
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    centre = weight @ values[:, 0]
    off = np.abs(values[:, 0] - centre) ** 2
    own = 0.5 * covariance[:, 0, 0].real + 0.5 * off
    out = np.diag([float(weight @ own)] * 2 + [sigma**2])
    radius = 0.0
    if values.shape[1] == 2:
        radii = np.abs(values[:, 1])
        radius = float(weight @ radii)
        out[2, 2] = float(weight @ (0.5 * covariance[:, 1, 1].real + (radii - radius) ** 2))
    way = weight @ ways
    rest = float(np.sqrt(weight @ np.mean(np.abs(rests) ** 2, axis=1) / 2.0))
    moved = np.column_stack([way.real, way.imag])
    middle = np.array([centre.real, centre.imag])
    return WanderingCone(
        middle, radius, moved, _phases(points - middle - moved, float(weight @ steps) * numbers), False, out,
        np.full(len(points), out[0, 0] + 2.0 * rest**2), rest, np.zeros_like(points),
    )  # fmt: skip


def _gains(heads: Array) -> tuple[complex, complex]:
    """How a height that goes round twice leans the plane of the heads, against the turn and with it."""
    design = np.column_stack([np.ones_like(heads), np.cos(heads), np.sin(heads)])
    _, cos, sin = np.linalg.pinv(design) @ np.exp(2j * np.outer(heads, [1.0, -1.0]))
    against, with_turn = cos + 1j * sin
    size = max(abs(against), abs(with_turn))
    return complex(against / size), complex(with_turn / size)


def _round_twice(phases: Array, gains: tuple[complex, complex]) -> Array:
    """(4, N, 2) how planes lean by a second harmonic of unit size, of two phases, and by what is left out."""
    turn = np.exp(2j * phases)
    leans = [gains[0] * a / turn + gains[1] * np.conj(a) * turn for a in (1.0, 1.0j)]
    leans += [_WITH_TURN * a * turn for a in (1.0, 1.0j)]
    found = np.array(leans)
    return np.stack([found.real, found.imag], axis=-1)


def _free(
    points: Array, noise: Array, numbers: Array, start: WanderingCone, harmonics: Array,
    gains: tuple[complex, complex] = (1.0, 0.0),
) -> WanderingCone | None:  # fmt: skip
    """Leave every phase free, from a start; None when that leads nowhere."""
    centre, radius, way, twice = start.centre, start.radius, start.way, np.zeros_like(points)
    count = len(points)
    step = float(np.median(np.diff(start.phases) / np.diff(numbers)))
    sizes, scales, leans = (a.ravel() for a in np.meshgrid(_WAYS, _NOISES, harmonics, indexing="ij"))
    for _ in range(_ITERATIONS):
        off = points - centre
        lean = off - way - twice
        outward = lean / np.linalg.norm(lean, axis=1, keepdims=True)
        phases = _phases(lean, step * numbers)
        kernel = _kernel(phases / (2.0 * math.pi))
        variance = np.einsum("na,nab,nb->n", outward, noise, outward)
        basis = _round_twice(phases, gains)
        outwards = np.einsum("bna,na->bn", basis, outward)
        total = (sizes**2)[:, None, None] * (kernel * (outward @ outward.T))
        total = total + (leans**2)[:, None, None] * (outwards.T @ outwards)
        total = total + (scales**2)[:, None, None] * np.diag(variance)
        missing = np.einsum("na,na->n", outward, off) - radius
        design = np.column_stack([outward, np.ones(count)])
        right = np.broadcast_to(np.column_stack([design, missing]), (len(sizes), count, 4))
        solved = np.linalg.solve(total, right)
        information = design.T @ solved[:, :, :3]
        covariance = np.linalg.inv(information)
        steps = np.einsum("mab,nb,mn->ma", covariance, design, solved[:, :, 3])
        weighted = solved[:, :, 3] - np.einsum("mna,ma->mn", solved[:, :, :3], steps)
        evidence = -0.5 * (
            np.linalg.slogdet(total)[1] + np.linalg.slogdet(information)[1] + weighted @ missing
        )
        weight = np.exp(evidence - evidence.max())
        weight /= weight.sum()
        move = weight @ steps
        pull = (weight * sizes**2) @ weighted
        before, way = way + twice, kernel @ (outward * pull[:, None])
        twice = np.einsum("bna,b->na", basis, outwards @ ((weight * leans**2) @ weighted))
        centre, radius = centre + move[:2], radius + float(move[2])
        if not 0.0 < radius <= _LARGEST:
            return None
        if max(np.abs(way + twice - before).max(), np.abs(move).max()) < _SETTLED:
            break
    else:
        return None
    spread = np.einsum("m,ma,mb->ab", weight, steps - move, steps - move)
    across = weight @ _across(outward, sizes, leans, kernel, basis, solved, design, covariance, total)
    rest = ((weight * scales**2) @ weighted) * variance
    return WanderingCone(
        centre, radius, way, phases, True, np.einsum("m,mab->ab", weight, covariance) + spread, across,
        float(np.sqrt(np.mean(rest**2))), twice,
    )  # fmt: skip


def _across(
    outward: Array, sizes: Array, leans: Array, kernel: Array, basis: Array, solved: Array, design: Array,
    covariance: Array, total: Array,
) -> Array:  # fmt: skip
    """(M, N) variance of every axis across its lean by each hypothesis: prior, less what distances tell."""
    aside = np.column_stack([-outward[:, 1], outward[:, 0]])
    asides, outwards = (np.einsum("bna,na->bn", basis, along) for along in (aside, outward))
    seen = (sizes**2)[:, None, None] * (kernel * (aside @ outward.T))  # of axis k in distance j
    seen = seen + (leans**2)[:, None, None] * (asides.T @ outwards)
    told = np.linalg.solve(total, np.swapaxes(seen, 1, 2))
    prior = (sizes**2)[:, None] * np.diag(kernel) + (leans**2)[:, None] * np.square(asides).sum(axis=0)
    prior = prior - np.einsum("mkj,mjk->mk", seen, told)
    lever = np.column_stack([aside, np.zeros(len(aside))]) - np.einsum("mkj,mja->mka", seen, solved[:, :, :3])
    out: Array = prior + np.einsum("mka,mab,mkb->mk", lever, covariance, lever)
    return out


def _phases(lean: Array, expected: Array) -> Array:
    """(N,) directions of leans (N, 2), growing as is expected, each within half a turn of it."""
    azimuth = np.arctan2(lean[:, 1], lean[:, 0])
    out: Array = expected + np.unwrap(azimuth - expected)
    return out


def _log_mean(evidence: Array) -> float:
    top = float(evidence.max())
    return top + math.log(float(np.exp(evidence - top).mean()))
