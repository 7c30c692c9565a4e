"""The known objects of LIBERO as a gallery: a GLB or URDF file each, in metres, named as the suites name them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from gvla2.geometry.transform import FloatArray, rigid
from gvla2.io.files import write_whole
from gvla2.robot.mujoco.objects import drawn_objects, moving_part
from gvla2.robot.mujoco.stepping import DRAWN, silent
from gvla2_plugins.libero.worlds import bddl_files

SUITES = ("libero_spatial", "libero_object", "libero_goal", "libero_10")
"""Whose objects are known by default."""


def write_gallery(folder: Path, suites: Sequence[str] = SUITES) -> list[str]:
    """Write the objects and fixtures that the suites' tasks name, from the package's meshes; returns their names.

    A rigid one is NAME.glb, one with joints NAME.urdf with LINK.glb for each link in the folder NAME.
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
    ((root, drawn),) = drawn_objects(model, data, DRAWN).items()
    if set(drawn) == {root}:
        _export(folder / f"{name}.glb", drawn[root], np.zeros(3))
        return
    robot = ET.Element("robot", name=name)
    for body in sorted({root, *drawn}):
        label, origin = "base", np.zeros(3)
        if body != root:
            part, number = moving_part(model, data, body, drawn[body]), int(model.body_jntadr[body])
            label, origin = part.name.replace(" ", "_"), data.xanchor[number]
            kind, (low, high) = "prismatic" if part.joint.slides else "revolute", model.jnt_range[number]
            joint = f'<parent link="base"/><child link="{label}"/><origin xyz="{_text(origin)}"/>'
            joint += f'<axis xyz="{_text(data.xaxis[number])}"/>'
            joint += f'<limit lower="{low}" upper="{high}" velocity="1" effort="100"/>'
            robot.append(ET.fromstring(f'<joint name="{label}_joint" type="{kind}">{joint}</joint>'))
        link = ET.SubElement(robot, "link", name=label)
        if body in drawn:
            file = f"{name}/{label}.glb"
            _export(folder / file, drawn[body], origin)
            ET.SubElement(ET.SubElement(ET.SubElement(link, "visual"), "geometry"), "mesh", filename=file)
    ET.indent(robot)
    write_whole(folder / f"{name}.urdf", ET.tostring(robot))


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _export(file: Path, meshes: Sequence[Any], origin: FloatArray) -> None:
    """A GLB file, whose frame has Y up, of meshes about ``origin`` (3,)."""
    scene = trimesh.Scene(meshes)
    scene.apply_transform(rigid(_TURN) @ rigid(translation=-origin))
    file.parent.mkdir(parents=True, exist_ok=True)
    scene.export(file)


_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""(3, 3) from our frame to that of GLB, Y up."""
