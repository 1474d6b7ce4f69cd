import numpy as np

from alignment.wheel.agreement import head_sums


def test_a_head_without_a_single_point_counts_as_nothing_wherever_it_stands() -> None:
    head = np.array([0, 0, 1, 1, 1])
    weights, residuals = np.array([1.0, 0.5, 0.0, 1.0, 2.0]), np.array([0.1, 0.2, np.nan, -0.3, 0.1])
    numbers, total, squares = head_sums(head, 3, weights, residuals)
    assert numbers.tolist() == [2.0, 2.0, 0.0]
    assert total.tolist() == [1.5, 3.0, 0.0]
    np.testing.assert_allclose(squares, [0.01 + 0.02, 0.09 + 0.02, 0.0])
