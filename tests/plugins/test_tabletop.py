from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import transform_points
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.robot.solids import body_points
from gvla2.robot.task import TaskInstance
from tests.plugins.tabletop_layouts import TABLE, near_the_base, sample, site, task

THREE = ("pick_and_lift", "push_block", "lamp_on")
seeds = st.integers(0, 2**31 - 1)


@dataclass
class State:
    """A world state by hand: what the bodies' poses, travels and holds are said to be."""

    poses: dict = field(default_factory=dict)
    peaks: dict = field(default_factory=dict)
    holding: str = ""

    def pose(self, body):
        return self.poses[body]

    def joint(self, name):
        return 0.0

    def peak(self, name):
        return self.peaks[name]

    def held(self, body):
        return body == self.holding


def at_start(instance: TaskInstance) -> State:
    poses = {body.name: body.world_from_body.copy() for body in instance.layout.bodies}
    return State(poses, {joint.name: 0.0 for joint in instance.layout.joints})


def verdicts(instance: TaskInstance, state: State) -> tuple[bool, bool]:
    return instance.succeeded["relaxed"](state), instance.succeeded["strict"](state)


def footprint(body) -> np.ndarray:
    """(K, 2) corners of all solids, seen from above."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = [transform_points(s.body_from_shape, 0.5 * signs * s.size) for s in body.solids]
    return transform_points(body.world_from_body, np.concatenate(corners))[:, :2]


@pytest.mark.parametrize("name", THREE)
@settings(max_examples=40, deadline=None)
@given(seed=seeds)
def test_layouts_are_on_the_table_inside_the_site_and_in_reach(name, seed):
    instance = sample(name, seed)
    assert verdicts(instance, at_start(instance)) == (False, False)
    for body in instance.layout.bodies:
        off = np.abs(footprint(body) - (0.25, 0.0))
        assert (off <= np.array([0.65, 0.91]) / 2 + 1e-9).all()
        if body.name != "lamp":  # its button must be in reach, its far end need not
            assert near_the_base(body.world_from_body[:3, 3])
        low = body_points(body, body.world_from_body)[:, 2].min()
        assert low == pytest.approx(TABLE, abs=1e-9) or body.name == "button"


# pick_and_lift


def lifted(instance: TaskInstance, colour: str, height: float) -> State:
    state = at_start(instance)
    body = next(b for b in instance.layout.bodies if b.solids[0].rgb == COLOURS[colour])
    state.poses[body.name][2, 3] += height
    state.holding = body.name
    return state


def test_lifting_the_named_cube_counts_and_lifting_another_does_not():
    instance = sample("pick_and_lift", 3)
    (named,) = colours_in(instance.instruction)
    others = [c for c, rgb in COLOURS.items() for b in instance.layout.bodies if b.solids[0].rgb == rgb]
    assert verdicts(instance, lifted(instance, named, 0.235)) == (True, True)
    for colour in set(others) - {named}:
        assert verdicts(instance, lifted(instance, colour, 0.235)) == (False, False)


# push_block


@pytest.mark.parametrize(
    ("along", "across", "up", "relaxed", "strict"),
    [
        (0.0, 0.0, 0.0, True, True),
        (0.049, 0.049, 0.0, True, False),
        (0.051, 0.0, 0.0, False, False),
        (0.032, 0.0, 0.0, True, True),
        (0.035, 0.0, 0.0, True, False),
        (0.0, 0.0, 0.10, False, False),
    ],
)
def test_where_the_block_counts_as_on_the_target(along, across, up, relaxed, strict):
    instance = sample("push_block", 2)
    block, target = instance.layout.bodies
    state = at_start(instance)
    pose = target.world_from_body.copy()
    pose[:3, 3] += pose[:3, 0] * along + pose[:3, 1] * across
    pose[2, 3] = block.world_from_body[2, 3] + up
    state.poses["block"] = pose
    assert verdicts(instance, state) == (relaxed, strict)


def test_what_does_not_fit_is_said():
    rng = np.random.default_rng(0)
    with pytest.raises(ConfigurationError, match="No place was found for 3 cubes"):
        task("pick_and_lift").sample(rng, site(size=(0.2, 0.2)))
    with pytest.raises(ConfigurationError, match="reach"):
        task("lamp_on").sample(rng, site(reachable=lambda point: False))


def test_the_lamp_shines_once_its_button_went_all_the_way():
    layout = sample("lamp_on", 2).layout
    (glow,) = layout.glows
    for travel, lit in ((0.0, False), (0.007, False), (0.008, True)):
        (shade,) = [b.solids[glow.solid] for b in layout.lit({"press": travel}) if b.name == glow.body]
        assert (shade.rgb == glow.rgb) == lit
