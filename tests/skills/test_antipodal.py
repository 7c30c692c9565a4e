from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import write_mesh
from gvla2.geometry.transform import rigid
from gvla2.planning.arm import Hand
from gvla2.planning.scene import KnownShape, SceneObject
from gvla2.skills.antipodal import antipodal, held_between, skin_of
from tests.scanning import bowl

HAND = Hand(0.08, 0.0463, 0.0152, 0.022, 0.0089, 0.204, 0.063)
OUT = np.array([1.0, 0.0, 0.0])


@pytest.fixture
def make_object(tmp_path):
    """Makes an object of a mesh standing on the table z = 0, known as a scan or by seen points alone."""

    def make(mesh: trimesh.Trimesh, *, seen: bool = False) -> SceneObject:
        vertices = np.asarray(mesh.vertices) - [0, 0, mesh.bounds[0, 2]]
        path = tmp_path / "object.obj"
        write_mesh(path, TriangleMesh(1000 * vertices, np.asarray(mesh.faces)))
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        points, _ = TriangleMesh(vertices, np.asarray(mesh.faces)).sample(1500, np.random.default_rng(0))
        known = None if seen else KnownShape("object", str(path), np.eye(4), 0.001)
        pose = rigid(translation=0.5 * (low + high))
        return SceneObject("o1", "object", "other", "", pose, high - low, points, known=known)

    return make


def cylinder(radius, height):
    return trimesh.creation.cylinder(radius, height, sections=48)


@pytest.mark.parametrize("seen", [False, True])
def test_a_can_is_held_across_its_middle_and_never_wider_than_the_hand(make_object, seen):
    found = antipodal(make_object(cylinder(0.03, 0.1), seen=seen), HAND, 0.0, OUT)
    assert {g.family for g in found} == {"top", "leaning", "side"}
    best = found[0]
    assert best.width == pytest.approx(0.06, abs=0.004)
    assert np.linalg.norm(best.centre[:2]) < 0.008
    assert all(g.width < g.opening * HAND.max_width <= HAND.max_width for g in found)
    assert [g.preference for g in found] == sorted((g.preference for g in found), reverse=True)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box(extents=(0.21, 0.16, 0.07)),
        cylinder(0.051, 0.14),
        trimesh.creation.box(extents=(0.21, 0.16, 0.012)),
        cylinder(0.051, 0.012),
    ],
    ids=["box", "can", "board", "lid"],
)
def test_what_would_be_squeezed_out_by_a_corner_or_a_rim_is_not_held(make_object, mesh):
    assert antipodal(make_object(mesh), HAND, 0.0, OUT) == []


@pytest.mark.parametrize("seen", [False, True])
def test_flat_crossed_blades_are_held_at_their_waist_though_only_their_top_was_seen(make_object, seen):
    blades = [trimesh.creation.box(extents=(0.2, 0.02, 0.014)) for _ in range(2)]
    for sign, blade in zip((1, -1), blades, strict=True):
        blade.apply_transform(trimesh.transformations.rotation_matrix(0.25 * sign, [0, 0, 1]))
    it = make_object(trimesh.util.concatenate(blades), seen=seen)
    it = replace(it, points=it.points[it.points[:, 2] > 0.0135])
    best = antipodal(it, HAND, 0.0, OUT)[0]
    assert best.width < 0.05
    assert abs(best.rotation[1, 1]) > 0.9
    assert np.hypot(*best.centre[:2]) < 0.06


def test_a_mug_is_held_at_its_handle_or_rim(make_object):
    mug = bowl(0.045, 0.09, 0.005)
    handle = trimesh.creation.torus(0.025, 0.006)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([0.06, 0, 0.045])
    found = antipodal(make_object(trimesh.util.concatenate([mug, handle])), HAND, 0.0, OUT)
    assert found
    assert all(g.width < 0.03 for g in found)  # 90 mm across: never the whole


def test_a_bottle_may_be_held_from_the_side_with_the_palm_off_the_table(make_object):
    found = [g for g in antipodal(make_object(cylinder(0.032, 0.22)), HAND, 0.0, OUT) if g.family == "side"]
    assert found
    for grasp in found:
        assert grasp.rotation[2, 2] > -0.7
        assert grasp.rotation[:, 2] @ OUT > 0
        palm = grasp.centre - (HAND.finger_length - HAND.tip_beyond_tcp) * grasp.rotation[:, 2]
        lowest = palm[2] - abs(grasp.rotation[2, 0]) * HAND.palm_depth / 2
        assert lowest > 0.0


def test_nothing_lies_where_the_fingers_go(make_object):
    spiked = trimesh.util.concatenate(
        [trimesh.creation.box(extents=(0.15, 0.03, 0.04)), cylinder(0.004, 0.12)]
    )
    it = make_object(spiked)
    skin = skin_of(it)
    for grasp in antipodal(it, HAND, 0.0, OUT):
        assert held_between(skin, grasp.rotation, grasp.centre, grasp.opening * HAND.max_width, HAND)


def test_a_hand_beside_or_on_an_object_holds_nothing(make_object):
    skin = skin_of(make_object(cylinder(0.03, 0.1)))
    down = Rotation.from_euler("x", np.pi).as_matrix()
    assert held_between(skin, down, np.array([0, 0, 0.08]), 0.08, HAND)
    assert not held_between(skin, down, np.array([0.2, 0, 0.08]), 0.08, HAND)
    assert not held_between(skin, down, np.array([0, 0.03, 0.08]), 0.08, HAND)
