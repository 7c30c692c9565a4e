from dataclasses import dataclass

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.planning.colours import COLOURS
from gvla2.robot.clutter import GAP, cluttered
from gvla2.robot.options import TaskConfig
from gvla2.robot.solids import body_points, planar
from gvla2.robot.task import Body, Joint, Layout, Primitive, TaskInstance, TaskSite
from gvla2.testing.robot import check_task

TABLE = 0.752
SITE = TaskSite((0.25, 0.0), (0.65, 0.91), TABLE, lambda point: True, table_rgb=(0.76, 0.61, 0.43))


@dataclass
class Options(TaskConfig):
    """Options of a task."""


def _box(name, size, colour, at, *, fixed=False):
    return Body(name, (Primitive("box", size, COLOURS[colour]),), planar(at[:2], at[2], 0.0), fixed=fixed)


class Push:
    """One red block, and a drawer that needs room."""

    instructions = ("push the block", "move the block", "shove the block", "nudge the block")

    def sample(self, rng, site, instruction=None):
        xy = rng.uniform((0.1, -0.2), (0.4, 0.2))
        block = _box("block", (0.05, 0.05, 0.05), "red", (*xy, TABLE + 0.025))
        chest = _box("chest", (0.1, 0.1, 0.1), "blue", (0.45, -0.3, TABLE + 0.05), fixed=True)
        drawer = _box("drawer", (0.08, 0.08, 0.02), "blue", (0.45, -0.3, TABLE + 0.11))
        slide = Joint("slide", "prismatic", "chest", "drawer", np.array([0, 1.0, 0]), np.zeros(3), (0.0, 0.3))
        said = self.instructions[int(rng.integers(4))] if instruction is None else instruction
        never = {"relaxed": lambda world: False, "strict": lambda world: False}
        return TaskInstance(said, Layout((block, chest, drawer), (slide,)), never)


def sample(seed=0, **options):
    return cluttered(Push(), Options(**options)).sample(np.random.default_rng(seed), SITE)


def flat(body):
    return body_points(body, body.world_from_body)


def test_the_contract_is_kept_and_the_task_lies_where_it_lay():
    check_task(cluttered(Push(), Options(distractors=4)), SITE)
    plain = Push().sample(np.random.default_rng(3), SITE)
    among = sample(3, distractors=4)
    assert among.instruction == plain.instruction
    assert [b.name for b in among.layout.bodies] == [
        "block", "chest", "drawer", *(f"distractor_{k}" for k in range(4))
    ]  # fmt: skip
    for before, after in zip(plain.layout.bodies, among.layout.bodies, strict=False):
        np.testing.assert_array_equal(before.world_from_body, after.world_from_body)


def test_what_the_task_needs_stays_clear():
    for seed in range(8):
        layout = sample(seed, distractors=4).layout
        added = [flat(b)[:, :2] for b in layout.bodies if b.name.startswith("distractor")]
        block = flat(layout["block"])[:, :2]
        drawn = np.array([[0.45, y] for y in np.linspace(-0.3, 0.0, 20)])
        for points in added:
            assert np.linalg.norm(points[:, None] - block, axis=2).min() > GAP
            assert np.linalg.norm(points[:, None] - drawn, axis=2).min() > GAP
        for i, one in enumerate(added):
            assert all(np.linalg.norm(one[:, None] - other, axis=2).min() > GAP for other in added[:i])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"distractors": 13}, "0 to 12"),
        ({"distractors": -1}, "0 to 12"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(ConfigurationError, match=message):
        cluttered(Push(), Options(**options))
