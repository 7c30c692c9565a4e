"""The picture of success against experience."""

from gvla2.evaluation.results import Cell
from gvla2.evaluation.robot.learning_curve import learning_curve


def cells(explored: int | None, won: int, of: int, **more: str) -> list[Cell]:
    told = {"arm": "off"} if explored is None else {
        "arm": f"after_{explored}", "variant": f"governed, explored={explored}",
    }  # fmt: skip
    factors = {"planner": "skill", "profile": "relaxed", **told, **more}
    return [Cell(f"{explored}-{i}", {**factors, "episode": i}, {"success": i < won}, {}) for i in range(of)]


def test_the_curve_begins_without_experience_and_has_a_point_an_arm():
    drawn = learning_curve([*cells(None, 2, 10), *cells(1, 5, 10), *cells(4, 9, 10)])
    assert drawn.startswith("<svg")
    assert drawn.count("<circle") == 3
    assert "skill, governed" in drawn


def test_with_fewer_points_there_is_no_picture():
    assert learning_curve([*cells(None, 2, 10), *cells(1, 5, 10)]) == ""
    assert learning_curve([]) == ""


def test_benches_that_differ_share_no_point():
    here = [*cells(None, 2, 10), *cells(1, 5, 10), *cells(4, 9, 10)]
    elsewhere = cells(None, 9, 10, depth_noise="l515")
    assert learning_curve([*here, *elsewhere]).count("<circle") == 3
    again = [*here, *cells(None, 2, 10)]
    assert learning_curve(again) == learning_curve(here), "what was measured twice counts once"
