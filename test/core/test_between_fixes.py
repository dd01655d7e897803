"""The way of the velocity along a step that takes long."""

import math

import pytest
from rovid_core.identify.ekf.between_fixes import LONGEST, parts


@pytest.mark.parametrize(('begin', 'end', 'count'), [
    (0.16, 0.0, 2), (LONGEST, 0.0, 1), (1.0, 0.05, 7), (0.3, 0.3, 0), (0.1, 0.7, 0),
    (0.1514, math.nextafter(0.1514, 0.0), 0), (LONGEST + 1e-16, 0.0, 1)])
def test_a_span_has_equal_parts_and_what_is_left_by_rounding_none(
        begin: float, end: float, count: int) -> None:
    """A force over no time is none: it would be a division by 0, and the data lost."""
    found = parts(begin, end)
    assert len(found) == count
    lengths = [one - other for one, other in found]
    assert lengths == pytest.approx([(begin - end) / max(count, 1)] * count)
    assert [one for one, _ in found[1:]] == [other for _, other in found[:-1]]
    assert not found or (found[0][0], found[-1][1]) == (begin, pytest.approx(end))
