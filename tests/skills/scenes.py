"""Scenes of a few objects, and requests about them without a word."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Advice, Plan, PlanRequest
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.workcell import make_cell
from gvla2.testing import inputs
from gvla2_plugins.sapien import SapienPandaConfig
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.planner import SkillPlanner

TABLE = 0.752
ARM = make_cell(SapienPandaConfig()).arm


def make_object(
    name, shape, xyz, size, *, yaw=0.0, turn=None, parent="", opening=0.0, label="", points=None
) -> SceneObject:
    """Something without a telling name; ``xyz`` is its box's middle, z above the table."""
    rotation = Rotation.from_euler("z", yaw).as_matrix() if turn is None else turn
    pose = rigid(rotation, (xyz[0], xyz[1], TABLE + xyz[2]))
    seen = np.zeros((0, 3)) if points is None else points
    return SceneObject(
        name, label or f"object {name}", shape, "", pose, np.array(size, float), seen, parent=parent, opening=opening
    )  # fmt: skip


def cube(name, xy, side=0.05, yaw=0.2) -> SceneObject:
    return make_object(name, "box", (*xy, side / 2), (side,) * 3, yaw=yaw)


def box(angle: float, xy=(0.12, -0.1)) -> tuple[SceneObject, SceneObject]:
    """A box and its lid, which is hinged at +x and open by ``angle``."""
    hinge = np.array([xy[0] + 0.125, xy[1], 0.155])
    turn = Rotation.from_euler("y", angle).as_matrix()
    lid = make_object(
        "lid", "plate", hinge - turn[:, 0] * 0.134, (0.268, 0.35, 0.01), turn=turn, parent="box"
    )
    return make_object("box", "box", (*xy, 0.075), (0.25, 0.35, 0.15)), lid


def drawer(xy=(0.30, 0.15)) -> tuple[SceneObject, ...]:
    return (
        make_object("cabinet", "box", (*xy, 0.08), (0.24, 0.28, 0.16)),
        make_object("drawer", "box", (xy[0] - 0.114, xy[1], 0.08), (0.012, 0.248, 0.128), parent="cabinet"),
        make_object("bar", "bar", (xy[0] - 0.16, xy[1], 0.125), (0.012, 0.11, 0.012), parent="drawer"),
    )


def jar(xy=(0.35, 0.15)) -> tuple[SceneObject, SceneObject]:
    return (
        make_object("jar", "cylinder", (*xy, 0.06), (0.07, 0.07, 0.12)),
        make_object("cap", "disc", (*xy, 0.13), (0.06, 0.06, 0.02), parent="jar"),
    )


def stuck_brick() -> tuple[SceneObject, ...]:
    """A brick between two slabs; a third of it sticks out at +y."""
    return (
        make_object("low", "box", (0.2, -0.1, 0.03), (0.2, 0.2, 0.06)),
        make_object("brick", "box", (0.2, -0.03, 0.075), (0.06, 0.18, 0.03)),
        make_object("high", "box", (0.2, -0.1, 0.12), (0.2, 0.2, 0.06)),
    )


PATCH = make_object("patch", "region", (0.4, -0.1, 0.0005), (0.1, 0.1, 0.001))
TRAY = make_object("tray", "box", (0.45, 0.25, 0.02), (0.2, 0.2, 0.04), opening=0.18)
POST = make_object("post", "cylinder", (0.25, -0.25, 0.05), (0.02, 0.02, 0.1))
RING = make_object("ring", "ring", (0.3, 0.1, 0.01), (0.07, 0.07, 0.02), opening=0.04)
LAMP = (
    make_object("lamp", "plate", (0.35, -0.3, 0.005), (0.16, 0.08, 0.01)),
    make_object("knob", "disc", (0.31, -0.3, 0.017), (0.033, 0.033, 0.014), parent="lamp"),
)


def bowl(xy=(0.42, 0.0)) -> SceneObject:
    """An open bowl, too wide for the hand: held by its wall."""
    angles = np.linspace(0.0, 2 * np.pi, 90)
    ring = np.column_stack(
        [xy[0] + 0.053 * np.cos(angles), xy[1] + 0.053 * np.sin(angles), np.full(90, TABLE)]
    )
    wall = np.concatenate([ring + np.array([0.0, 0.0, z]) for z in np.linspace(0.0, 0.053, 8)])
    return make_object("bowl", "cylinder", (*xy, 0.0265), (0.11, 0.11, 0.053), opening=0.1, points=wall)


def request(*objects: SceneObject, effects=(), **more) -> PlanRequest:
    scene = Scene(objects, TABLE, ARM.workspace)
    start = ARM.forward(ARM.home)
    seen = replace(inputs.observation(16), world_from_tcp=start, joints=ARM.home)
    return PlanRequest("", scene, ARM, start, ARM.home, seen, Advice(effects=tuple(effects)), **more)


def sound(plan: Plan, asked: PlanRequest) -> Plan:
    """The plan, which has a trajectory that passes every check."""
    assert plan.trajectory is not None, plan.abstention
    report = check_trajectory(
        plan.trajectory, asked.scene, ARM, asked.start, asked.joints,
        effects=asked.advice.effects, parameters=plan.parameters, skill=plan.skill,
    )  # fmt: skip
    assert report.passed, report.reasons
    return plan


def at(plan: Plan, stage: str) -> np.ndarray:
    assert plan.trajectory is not None, plan.abstention
    return np.array(next(w.xyz for w in plan.trajectory if w.stage == stage))


def named(name, label, shape, xyz, size, yaw=0.0, **more) -> SceneObject:
    """An object with a label, whose first word is its colour."""
    return replace(make_object(name, shape, xyz, size, yaw=yaw, label=label, **more), colour=label.split()[0])


def asked(sentence: str, *objects: SceneObject, effects=(), **more) -> tuple[Plan, PlanRequest]:
    """The plan of ``planner=skill`` for a sentence, and its request; a trajectory passes every check."""
    given = replace(request(*objects, effects=effects, **more), instruction=sentence)
    made = SkillPlanner(SkillConfig()).plan(given)
    assert (made.trajectory is None) == (made.abstention is not None)
    return (made if made.trajectory is None else sound(made, given)), given
