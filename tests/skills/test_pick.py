"""Which holds of an object are offered: by its box, as far as its surface does not contradict, and by its surface."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import write_mesh
from gvla2.geometry.transform import rigid, transform_points
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.scene import KnownShape
from gvla2.planning.skill import Job
from gvla2.planning.trajectory import grasp_rotation
from gvla2.skills.carry_out import carry_out
from gvla2.skills.grasps import grasps
from gvla2.skills.schemas.pick_place import take
from gvla2.skills.table import STANDARD
from tests.scanning import bowl
from tests.skills.scenes import TABLE, at, make_object, request, sound

AT = np.array([0.35, 0.1])


def seen(mesh, shape, *, opening=0.0):
    """An object on the table with points of its whole surface, taken for a simple ``shape`` by its box."""
    size = np.asarray(mesh.extents)
    points = np.asarray(trimesh.sample.sample_surface(mesh, 2000, seed=0)[0])
    points = points - mesh.bounds[0] - 0.5 * size * [1, 1, 0] + [*AT, TABLE]
    return make_object("it", shape, (*AT, 0.5 * size[2]), size, points=points, opening=opening)


def picked(it):
    asked = request(it)
    return carry_out([SkillCall("pick", "it")], asked), asked


def test_a_bowl_taken_for_a_disc_is_held_by_its_rim():
    plan, asked = picked(seen(bowl(0.08, 0.06, 0.006), "disc", opening=0.14))
    sound(plan, asked)
    assert 0.05 < np.linalg.norm(at(plan, "close")[:2] - AT) < 0.09


def test_a_tool_with_its_head_up_is_not_gripped_where_its_box_is_empty():
    head = trimesh.creation.box(extents=(0.03, 0.03, 0.10))
    handle = trimesh.creation.box(extents=(0.25, 0.03, 0.02))
    handle.apply_translation((0.14, 0, -0.04))
    plan, asked = picked(seen(trimesh.util.concatenate([head, handle]), "box"))
    sound(plan, asked)
    close = at(plan, "close")
    assert abs(close[0] - (AT[0] - 0.125)) < 0.03 or close[2] < TABLE + 0.04  # by its head, or low enough


@pytest.mark.parametrize("shape", ["box", "other"])
def test_what_is_too_wide_by_box_and_surface_is_refused(shape):
    plan, _ = picked(seen(trimesh.creation.box(extents=(0.2, 0.16, 0.07)), shape))
    assert plan.abstention is not None
    assert plan.abstention.kind == "too_wide"


def test_a_known_bowl_that_leans_is_set_down_upright(tmp_path):
    mesh = bowl(0.055, 0.05, 0.004)
    write_mesh(tmp_path / "bowl.obj", TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    pose = rigid(Rotation.from_euler("y", 0.35).as_matrix(), [*AT, TABLE + 0.03 - mesh.bounds[0, 2]])
    points = transform_points(pose, trimesh.sample.sample_surface(mesh, 2000, seed=0)[0])
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high) - [0.0, 0.0, TABLE]
    known = KnownShape("bowl", str(tmp_path / "bowl.obj"), pose, up=np.array([0.0, 0.0, 1.0]))
    it = replace(make_object("it", "disc", middle, high - low, points=points, opening=0.1), known=known)
    asked = request(it, make_object("plate", "disc", (0.4, -0.15, 0.01), (0.15, 0.15, 0.02)))
    plan = sound(carry_out([SkillCall("place", "it", "plate", relation="on")], asked), asked)
    taken, left = (next(w for w in plan.trajectory if w.stage == stage) for stage in ("close", "release"))
    taken, left = (
        rigid(grasp_rotation(w.orientation.vector, w.orientation.closing), w.xyz) for w in (taken, left)
    )
    there = left @ np.linalg.inv(taken) @ pose
    assert there[2, 2] > 0.999
    assert TABLE + 0.02 < transform_points(there, mesh.vertices)[:, 2].min() < TABLE + 0.03


def test_a_hand_between_tall_neighbours_comes_from_above_them():
    flat = make_object("it", "box", (*AT, 0.015), (0.08, 0.05, 0.03))
    tall = make_object("tall", "box", (AT[0], AT[1] + 0.09, 0.07), (0.05, 0.05, 0.14))
    wanted = request(flat, tall)
    theta = STANDARD["place"].defaults(flat, wanted.arm.hand, SkillOptions())
    job = Job("place", wanted.scene, wanted.arm.hand, wanted.arm.workspace, theta, flat)
    grasp = next(one for one in grasps(job) if one.family == "top")
    usual, between = (take(job, grasp, between=high).trajectory() for high in (False, True))
    assert [one.stage for one in between] == ["approach", "descend", "grasp", "close"]
    assert between.waypoints[0].xyz[2] - wanted.arm.hand.tip_beyond_tcp > tall.top
    np.testing.assert_allclose(between.waypoints[1].xyz, usual.waypoints[0].xyz)
