"""The known objects of LIBERO as a gallery: a GLB or URDF file each, in metres, named as the suites name them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from gvla2.geometry.transform import rigid
from gvla2.io.files import write_whole
from gvla2.robot.mujoco.description import add_joint, painted
from gvla2.robot.mujoco.stepping import DRAWN, silent
from gvla2.robot.mujoco.truth import model_joint, moving_body, part_label
from gvla2_plugins.libero.worlds import bddl_files

SUITES = ("libero_spatial", "libero_object", "libero_goal", "libero_10")
"""Whose objects are known by default."""


def write_gallery(folder: Path, suites: Sequence[str] = SUITES) -> list[str]:
    """Write the objects and fixtures that the suites' tasks name, from the package's meshes; returns their names.

    A rigid one is NAME.glb, one with joints NAME.urdf with a mesh for each link in the folder NAME.
    """
    files = [file for task, file in bddl_files().items() if task.partition("/")[0] in suites]
    with silent():
        from libero.libero.envs.objects import OBJECTS_DICT
    named = {name for file in files for name in _categories(file.read_text())} & OBJECTS_DICT.keys()
    folder.mkdir(parents=True, exist_ok=True)
    for name in sorted(named):
        _write(folder, name, _compiled(OBJECTS_DICT[name](name=name)))
    return sorted(named)


def _categories(bddl: str) -> set[str]:
    """The categories of a task's objects and fixtures, from ``(:objects name_1 name_2 - category ...)``."""
    blocks = re.findall(r"\(:(?:objects|fixtures)([^)]*)\)", bddl)
    return {category for block in blocks for category in re.findall(r"-\s+(\w+)", block)}


def _compiled(obj: Any) -> Any:
    """The model of an empty world with the object in it."""
    import mujoco
    from robosuite.models import MujocoWorldBase

    world = MujocoWorldBase()
    world.merge_assets(obj)
    world.worldbody.append(obj.get_obj())
    return mujoco.MjModel.from_xml_string(world.get_xml())


def _write(folder: Path, name: str, model: Any) -> None:
    """The object's files: one scene of all that is drawn, or a URDF of what moves on joints of its own."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    drawn: dict[int, list[Any]] = {}
    for body in range(1, model.nbody):
        if meshes := painted(model, data, body, DRAWN):
            drawn.setdefault(moving_body(model, body), []).extend(meshes)
    root = int(model.body_rootid[model.nbody - 1])
    if set(drawn) == {root}:
        scene = trimesh.Scene(drawn[root])
        scene.apply_transform(rigid(_TURN))
        scene.export(folder / f"{name}.glb")
        return
    robot = ET.Element("robot", name=name)
    for owner in sorted({root, *drawn}):
        label = "base" if owner == root else _link_name(model, data, owner, name, drawn[owner])
        link = ET.SubElement(robot, "link", name=label)
        origin = np.zeros(3) if owner == root else data.xanchor[model.body_jntadr[owner]]
        for number, mesh in enumerate(drawn.get(owner, [])):
            file = folder / name / f"{label}_{number}" / "mesh.obj"
            file.parent.mkdir(parents=True, exist_ok=True)
            mesh.apply_translation(-origin)
            mesh.export(file)
            shape = ET.SubElement(ET.SubElement(link, "visual"), "geometry")
            ET.SubElement(shape, "mesh", filename=file.relative_to(folder).as_posix())
        if owner != root:
            joint = int(model.body_jntadr[owner])
            kind = "prismatic" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
            ends, pose = ("base", label), rigid(translation=origin)
            add_joint(robot, f"{label}_joint", kind, ends, pose, data.xaxis[joint], model.jnt_range[joint])
    ET.indent(robot)
    write_whole(folder / f"{name}.urdf", ET.tostring(robot))


_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""(3, 3) from our frame to that of GLB, Y up."""


def _link_name(model: Any, data: Any, body: int, whole: str, meshes: Sequence[Any]) -> str:
    joint = model_joint(model, data, int(model.body_jntadr[body]))
    points = np.concatenate([mesh.vertices for mesh in meshes])
    return part_label(model.body(body).name, whole.split("_"), joint, points).replace(" ", "_")
