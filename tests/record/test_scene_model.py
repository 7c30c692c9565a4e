"""A run in 3D: what the file holds, read back by trimesh, and what a page does with it."""

import io
import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from gvla2.episode.record import EpisodeRecord
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import to_z_up, write_mesh
from gvla2.geometry.transform import rigid
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.scene import KnownShape
from gvla2.record.scene_model import MOST_FACES, cloud, scene_glb, solid_of
from gvla2.testing.inputs import RED, TABLE

Episode = Callable[..., EpisodeRecord]


def nodes(data: bytes) -> dict[str, dict[str, Any]]:
    """The extras of a GLB file's nodes, by name."""
    (length,) = struct.unpack("<I", data[12:16])
    return {node["name"]: node["extras"] for node in json.loads(data[20 : 20 + length])["nodes"]}


def geometry(data: bytes) -> dict[str, Any]:
    return trimesh.load_scene(io.BytesIO(data), file_type="glb").geometry


def test_objects_stand_where_they_were_perceived_in_their_colours(episode: Episode) -> None:
    record = episode()
    data = scene_glb(record)
    solids, found = geometry(data), nodes(data)
    for k, obj in enumerate(record.scene.objects):
        corners = to_z_up(solids[obj.id].vertices)
        np.testing.assert_allclose(corners.min(axis=0), obj.corners().min(axis=0), atol=1e-6)
        np.testing.assert_allclose(corners.max(axis=0), obj.corners().max(axis=0), atol=1e-6)
        assert found[obj.id]["label"] == f"{k + 1} {obj.label}"
        assert obj.label in found[obj.id]["text"]


def test_the_path_leads_from_the_hand_through_all_waypoints(episode: Episode) -> None:
    record = episode()
    data = scene_glb(record)
    path, found = to_z_up(geometry(data)["path"].vertices), nodes(data)
    stops = [record.observation.world_from_tcp[:3, 3], *(np.array(w.xyz) for w in record.plan.trajectory)]
    for stop in stops:
        assert np.linalg.norm(path - stop, axis=1).min() < 0.02
    for k, waypoint in enumerate(record.plan.trajectory):
        extras = found[f"waypoint {k}"]
        np.testing.assert_allclose(to_z_up(extras["at"]), waypoint.xyz, atol=1e-4)
        assert waypoint.stage in extras["text"]
        assert not extras["bad"]


def test_a_failed_check_marks_its_waypoint_alone(episode: Episode) -> None:
    checks = CheckReport((Finding("clearance", False, 3, "collision", "Too near the blue cube."),))
    found = nodes(scene_glb(episode(checks=checks)))
    assert [found[f"waypoint {k}"]["bad"] for k in range(6)] == [k == 3 for k in range(6)]
    assert "Too near the blue cube." in found["waypoint 3"]["text"]
    assert "not checked" in nodes(scene_glb(episode(checks=None)))["waypoint 3"]["text"]


def test_the_cloud_is_what_the_cameras_measured_thinned(episode: Episode) -> None:
    record = episode()
    points, colours = cloud(record.observation, record.scene.workspace)
    assert len(points) == len(colours) > 1000
    assert np.isfinite(points).all()
    on_red = np.linalg.norm(points - [*RED.centre, TABLE + RED.side], axis=1) < 0.02  # its top
    assert on_red.any()
    red = colours[on_red].astype(float).mean(axis=0)
    assert red[0] > 2 * red[1:].max()
    few, _ = cloud(record.observation, record.scene.workspace, most=50)
    assert len(few) == 50
    assert len(geometry(scene_glb(record))["seen"].vertices) == len(points)


def test_an_episode_that_ended_early_shows_what_it_has(episode: Episode) -> None:
    assert scene_glb(episode(scene=None)) == b""
    found = nodes(scene_glb(episode(observation=None, plan=None)))
    assert [extras["kind"] for extras in found.values()] == ["ground", "object", "object"]


def test_a_recognised_scan_is_shown_as_it_is_unless_it_is_huge_or_gone(
    episode: Episode, tmp_path: Path
) -> None:
    obj = episode().scene.objects[0]
    small, huge = trimesh.creation.icosphere(1, 0.03), trimesh.creation.icosphere(5, 0.03)
    assert len(huge.faces) > MOST_FACES
    for name, mesh in (("small", small), ("huge", huge)):
        write_mesh(tmp_path / f"{name}.ply", TriangleMesh(mesh.vertices, mesh.faces))

    def shown(name: str) -> Any:
        pose = rigid(translation=obj.centre)
        return solid_of(replace(obj, known=KnownShape(name, str(tmp_path / f"{name}.ply"), pose)))

    assert shown("small").volume == pytest.approx(small.volume, rel=1e-4)
    np.testing.assert_allclose(shown("small").bounds.mean(axis=0), obj.centre, atol=1e-6)
    for name in ("huge", "gone"):
        assert shown(name).volume == pytest.approx(np.prod(obj.extents))
