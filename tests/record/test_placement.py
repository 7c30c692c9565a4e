from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.record.drawing import Rect, around, place

BOUNDS = Rect(0, 0, 400, 300)


@given(st.floats(-50, 450), st.floats(-50, 350), st.floats(10, 120))
@settings(max_examples=60, deadline=None)
def test_labels_stay_inside(x: float, y: float, width: float) -> None:
    spot = place(around(x, y, 10), (width, 20), [], BOUNDS)
    assert spot.overlap(BOUNDS) > 0.999 * spot.area


def test_labels_in_a_crowd_do_not_cover_one_another() -> None:
    dots = [around(200 + 24 * k, 150, 10) for k in range(5)]
    taken = list(dots)
    for dot in dots:
        spot = place(dot, (90, 20), taken, BOUNDS)
        assert all(spot.overlap(other) == 0 for other in taken)
        taken.append(spot)
