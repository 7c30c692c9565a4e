"""Parts with known joints: drawers are pulled and shut and knobs turned as far as they go, whatever their height."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.perception.articulated import MovingPart, with_parts
from gvla2.planning.calls import SkillCall
from gvla2.planning.scene import PartJoint, SceneObject
from gvla2.skills.carry_out import carry_out
from gvla2.skills.mechanisms import slide_for
from tests.skills.scenes import TABLE, at, bowl, cube, make_object, request, sound

REACH = 0.16
HEIGHTS = {"bottom": 0.045, "middle": 0.118, "top": 0.19}
"""Of the handles above the table, metres."""


def grid(low, high, count=6) -> np.ndarray:
    axes = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)


def cabinet(ajar: str = "") -> tuple[SceneObject, ...]:
    """Three drawers one above the other that open towards the robot, with bars before them; one may be open."""
    body = grid((0.40, -0.12, TABLE), (0.60, 0.12, TABLE + 0.23))
    parts = []
    for name, height in HEIGHTS.items():
        z, opened = TABLE + height, REACH if name == ajar else 0.0
        front = grid((0.396, -0.11, z - 0.03), (0.40, 0.11, z + 0.03))
        bar = grid((0.362, -0.045, z - 0.008), (0.378, 0.045, z + 0.008))
        points = np.concatenate([front, bar]) - [opened, 0.0, 0.0]
        joint = PartJoint(True, np.array([-1.0, 0.0, 0.0]), np.zeros(3), opened, REACH)
        parts.append(MovingPart(f"{name} drawer", points, joint))
    whole = make_object("c", "box", (0.50, 0.0, 0.115), (0.2, 0.24, 0.23), points=body, label="cabinet")
    return tuple(with_parts(whole, body, parts))


def knob(position: float = 0.0) -> tuple[SceneObject, ...]:
    """A stove with a round knob beside it that has a bar across; it turns by up to 2 radians."""
    turn = Rotation.from_euler("z", position).as_matrix()
    angles = np.linspace(0.0, 2 * np.pi, 60)
    disc = np.column_stack([0.045 * np.cos(angles), 0.045 * np.sin(angles), np.full(60, 0.015)])
    points = np.concatenate([disc, grid((-0.04, -0.012, 0.015), (0.04, 0.012, 0.05))]) @ turn.T
    points += [0.35, -0.15, TABLE]
    joint = PartJoint(False, np.array([0.0, 0.0, 1.0]), np.array([0.35, -0.15, TABLE]), position, 2.0)
    whole = make_object("s", "box", (0.50, -0.15, 0.01), (0.19, 0.19, 0.02), label="stove")
    return tuple(
        with_parts(
            whole,
            grid((0.40, -0.24, TABLE), (0.60, -0.05, TABLE + 0.02)),
            [MovingPart("knob", points, joint)],
        )
    )


@pytest.mark.parametrize("name", HEIGHTS)
def test_a_drawer_at_any_height_comes_as_far_as_its_joint_goes(name):
    asked = request(*cabinet())
    drawer = next(o for o in asked.scene.objects if o.label == f"{name} drawer")
    plan = sound(carry_out([SkillCall("open", drawer.id)], asked), asked)
    hooked = any(w.stage == "hook" for w in plan.trajectory)
    pulled = at(plan, "pull") - at(plan, "hook" if hooked else "close")
    assert pulled[0] == pytest.approx(-REACH, abs=0.005)
    assert np.abs(pulled[1:]).max() < 1e-6
    assert hooked == (name == "bottom"), "only there the hand has no room below the bar"


def test_an_open_drawer_is_pushed_shut_and_not_pulled_again():
    asked = request(*cabinet("middle"))
    drawer = next(o for o in asked.scene.objects if o.label == "middle drawer")
    plan = sound(carry_out([SkillCall("close", drawer.id)], asked), asked)
    assert (at(plan, "push") - at(plan, "touch"))[0] == pytest.approx(REACH, abs=0.005)
    again = carry_out([SkillCall("pull", drawer.id)], asked)
    assert again.abstention is not None
    assert "open already" in again.abstention.message
    shut = carry_out([SkillCall("close", drawer.id)], request(*cabinet()))
    assert "closed already" in shut.abstention.message


def test_a_joint_says_which_way_a_drawer_goes_even_without_a_visible_handle():
    objects = cabinet()
    bare = request(*(o for o in objects if o.shape != "bar"))
    slide = slide_for(bare.scene["c.0"], bare.scene)
    assert (slide.front.id, slide.body.id) == ("c.0", "c")
    assert slide.out == pytest.approx([-1.0, 0.0, 0.0])
    assert "no handle" in carry_out([SkillCall("pull", "c.0")], bare).abstention.message


@pytest.mark.parametrize(("position", "turn"), [(0.0, 2.0), (1.5, -1.5)])
def test_a_knob_is_held_across_its_bar_and_turned_about_its_axis(position, turn):
    asked = request(*knob(position))
    plan = sound(carry_out([SkillCall("twist", "s.0", theta={"turn": turn})], asked), asked)
    steps = [w for w in plan.trajectory if w.stage in ("close", "turn")]
    closing = [np.arctan2(*w.orientation.closing[1::-1]) for w in steps]
    turned = float(np.unwrap(closing)[-1] - closing[0])
    assert turned == pytest.approx(turn + (0.0 if turn > 0 else -0.1), abs=0.01), "off is a stop"
    bar = closing[0] - (position + 0.5 * np.pi)
    assert abs(np.sin(bar)) < 0.3, "across the bar"
    assert all(np.hypot(*(np.subtract(w.xyz, (0.35, -0.15, 0.0))[:2])) < 0.003 for w in steps)


@pytest.mark.parametrize(("height", "how"), [(0.054, "above its neighbours"), (0.066, "tilted by")])
def test_a_low_object_beside_a_higher_one_is_grasped_with_the_palm_above_it(height, how):
    low = make_object("low", "box", (0.40, 0.0, 0.0095), (0.08, 0.043, 0.019))
    wall = make_object("wall", "box", (0.40, 0.10, height / 2), (0.2, 0.06, height))
    asked = request(low, wall, cube("goal", (0.30, -0.25)))
    plan = sound(carry_out([SkillCall("place", "low", "goal")], asked), asked)
    assert how in next(c.description for c in plan.candidates if not c.rejected)


def test_an_occupied_place_beside_a_goal_is_left_free():
    goal, taken = make_object("goal", "box", (0.45, 0.0, 0.05), (0.1, 0.2, 0.1)), cube("taken", (0.45, 0.155))
    free, occupied = request(cube("a", (0.35, -0.2)), goal), request(cube("a", (0.35, -0.2)), goal, taken)
    plans = [
        sound(carry_out([SkillCall("place", "a", "goal", relation="left_of")], r), r)
        for r in (free, occupied)
    ]
    first, second = (at(plan, "place")[:2] for plan in plans)
    assert first[0] == pytest.approx(0.45, abs=0.03)
    assert abs(second[0] - 0.45) > 0.03


def test_what_is_under_an_overhang_is_drawn_aside_before_it_rises():
    over = make_object("over", "box", (0.535, 0.0, 0.175), (0.18, 0.3, 0.05))
    call = SkillCall("place", "bowl", "patch")
    patch = make_object("patch", "region", (0.35, -0.28, 0.0005), (0.1, 0.1, 0.001))
    plans = [sound(carry_out([call], r), r) for r in (request(bowl(), patch), request(bowl(), patch, over))]
    straight, aside = (np.hypot(*(at(plan, "lift") - at(plan, "close"))[:2]) for plan in plans)
    assert straight < 1e-6
    assert aside > 0.01
