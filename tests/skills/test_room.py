"""Room: nothing goes where it is already, nor where it does not fit."""

from __future__ import annotations

import pytest

from gvla2.skills.validation import no_room
from tests.skills.scenes import TRAY, cube, jar, make_object, request, stuck_brick

CUBE = cube("a", (0.3, 0.1))
SOLID = make_object("b", "box", (0.1, 0.1, 0.05), (0.1, 0.1, 0.1), label="maroon cube")
NARROW = make_object("n", "box", (0.1, 0.2, 0.03), (0.06, 0.06, 0.06), label="gray tray", opening=0.03)
STICK = make_object("s", "bar", (0.3, 0.1, 0.15), (0.02, 0.02, 0.26))
DEEP = make_object("c", "cylinder", (0.3, 0.1, 0.05), (0.12, 0.12, 0.1), label="white cup", opening=0.11)


@pytest.mark.parametrize(
    ("theme", "goal", "objects", "why"),
    [
        (CUBE, SOLID, (), "does not seem to be open"),
        (CUBE, NARROW, (), "too large"),
        (STICK, DEEP, (), "already"),
        (jar()[1], jar()[0], (), "already"),
        (stuck_brick()[1], stuck_brick()[0], stuck_brick(), "already"),
    ],
)
def test_what_cannot_go_in_is_refused(theme, goal, objects, why):
    refusal = no_room(theme, goal, "in", request(*(objects or (theme, goal))).scene)
    assert refusal is not None
    assert why in refusal.message


@pytest.mark.parametrize(
    ("goal", "relation"), [(SOLID, "on"), (NARROW, "on"), (TRAY, "in"), (DEEP, "beside")]
)
def test_what_has_room_is_not_refused(goal, relation):
    assert no_room(CUBE, goal, relation, request(CUBE, goal).scene) is None
