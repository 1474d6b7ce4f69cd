import numpy as np

from alignment.stereo.correspondence import Candidates
from alignment.stereo.pool import PointPool


def candidates(seed: int, count: int) -> Candidates:
    rng = np.random.default_rng(seed)
    point = np.sort(rng.integers(0, count // 2, count))
    return Candidates(
        points=rng.standard_normal((count, 3)),
        sigma=rng.uniform(0.01, 0.1, count),
        rays=rng.standard_normal((count, 3)),
        spread=rng.uniform(0.1, 0.5, count),
        light=rng.uniform(0.5, 2.0, (count, 3)),
        left_point=point,
        left_line=point // 40,
        right_point=rng.integers(0, count, count),
        offered=count,
    )


def test_numbers_of_one_head_never_return_in_the_next() -> None:
    pool = PointPool.of([candidates(1, 300), candidates(2, 200)])
    for numbers in (pool.group, pool.line, pool.cluster):
        first, second = numbers[pool.head == 0], numbers[pool.head == 1]
        assert first.max() < second.min()
        assert (np.diff(numbers) >= 0).all()


def test_a_cluster_never_reaches_over_the_end_of_its_line() -> None:
    pool = PointPool.of([candidates(3, 400)])
    for number in np.unique(pool.cluster):
        assert len(np.unique(pool.line[pool.cluster == number])) == 1


def test_the_points_of_a_mask_are_those_that_indexing_gives() -> None:
    pool = PointPool.of([candidates(4, 300), candidates(5, 200)])
    mask = np.random.default_rng(6).random(500) < 0.7
    part = pool.where(mask)
    for name in ("points", "sigma", "rays", "spread", "light", "group", "cluster", "line", "head"):
        np.testing.assert_array_equal(getattr(part, name), getattr(pool, name)[mask])
