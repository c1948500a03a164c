"""What a robot file states of its numbers: standard deviations and correlations."""

import numpy as np
import pytest

from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.robot.stated import check_stated, stated_numbers

NAMES = {"parameters": ["a", "b", "c"], "stddev": [1.0, 2.0, 0.5]}
WHOLE = [[1.0, 0.3, 0.1], [0.3, 1.0, -0.5], [0.1, -0.5, 1.0]]
TRIANGLE = [[1.0], [0.3, 1.0], [0.1, -0.5, 1.0]]


def refused(place, why):
    return RobotFileError(f"{place} {why}")


@pytest.mark.parametrize("rows", [WHOLE, TRIANGLE])
def test_a_correlation_is_given_whole_or_by_its_lower_triangle(rows):
    entry = {**NAMES, "correlation": rows}
    check_stated(entry, refused)
    np.testing.assert_array_equal(stated_numbers(entry).correlation, WHOLE)


@pytest.mark.parametrize(
    "rows",
    [
        [[1.0, 0.3, 0.1], [0.3, 1.0, -0.5], [0.1, -0.4, 1.0]],
        [[1.0], [0.9, 1.0], [-0.9, 0.9, 1.0]],
        [[1.0], [0.3, 0.9], [0.1, -0.5, 1.0]],
    ],
)
def test_a_matrix_that_is_no_correlation_is_refused(rows):
    with pytest.raises(RobotFileError, match="with 1 on the diagonal and no negative eigenvalue"):
        check_stated({**NAMES, "correlation": rows}, refused)


@pytest.mark.parametrize("rows", [WHOLE[:2], TRIANGLE[:2], [*TRIANGLE[:2], [0.1, -0.5]], []])
def test_rows_of_other_lengths_are_refused(rows):
    with pytest.raises(RobotFileError, match="3 rows of 3 numbers, or its lower triangle"):
        check_stated({**NAMES, "correlation": rows}, refused)
