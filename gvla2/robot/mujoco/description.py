"""An arm of a compiled MuJoCo model as a URDF: kinematics, collisions and its own pixels follow from it."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import RobotError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import write_mesh
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid
from gvla2.io.array_cache import cache_folder
from gvla2.io.files import write_whole


@dataclass(frozen=True)
class ArmNames:
    """What an arm is called in its model: the ``base`` body, whose tree is the robot, and the ``tool`` body, whose z
    points out of the hand; its ``joints`` from the base on and the two sliding joints of its ``fingers``.
    """

    base: str
    tool: str
    joints: tuple[str, ...]
    fingers: tuple[str, ...]

    def check(self, model: Any) -> None:
        """Raises :class:`RobotError` for a name that the model lacks, with the names that it has."""
        try:
            for body in (self.base, self.tool):
                model.body(body)
            for joint in (*self.joints, *self.fingers):
                model.joint(joint)
        except KeyError as error:
            raise RobotError(f"The arm's names do not fit its model: {error.args[0]}") from error


def robot_bodies(model: Any, base: str) -> list[int]:
    """Indices of the bodies of the tree that begins at ``base``, parents first."""
    mine = [int(model.body(base).id)]
    for body in range(mine[0] + 1, model.nbody):
        if model.body_parentid[body] in mine:
            mine.append(body)
    return mine


def write_urdf(model: Any, names: ArmNames, speed: float) -> Path:
    """A URDF of the arm with its hand, in the cache; ``speed`` is the limit of its joints, rad/s.

    Links are the bodies that move or that ``names`` has, with what is fixed to them. What collides becomes collision,
    the rest of the drawn geometry visual. Raises :class:`RobotError` for joints that a URDF cannot have.
    """
    import mujoco

    names.check(model)
    data = mujoco.MjData(model)
    for name in (*names.joints, *names.fingers):
        data.joint(name).qpos[0] = 0.0
    mujoco.mj_kinematics(model, data)
    robot = ET.Element("robot", name=names.base)
    links: dict[int, tuple[ET.Element, FloatArray]] = {}  # by body: its link, and world_from_link (4, 4)
    for body in robot_bodies(model, names.base):
        joint, name = _joint_of(model, body), model.body(body).name or f"body{body}"
        parent = links.get(int(model.body_parentid[body]))
        if parent is not None and joint is None and name != names.tool:
            links[body] = parent
        else:
            # A URDF's joint goes through its link's origin.
            turn = data.xmat[body].reshape(3, 3)
            pose = rigid(turn, data.xpos[body] + (0.0 if joint is None else turn @ joint.pos))
            link = ET.SubElement(robot, "link", name=name)
            links[body] = link, pose
            if parent is not None:
                ends, at = (parent[0].get("name", ""), name), invert_rigid(parent[1]) @ pose
                own = joint if joint and joint.name in (*names.joints, *names.fingers) else None
                _link(robot, ends, at, own, speed)
        link, world_from_link = links[body]
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            world_from_geom = rigid(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
            _add_geometry(link, model, geom, invert_rigid(world_from_link) @ world_from_geom)
    text = ET.tostring(robot)
    path = cache_folder() / "mjcf" / f"{hashlib.sha256(text).hexdigest()[:32]}.urdf"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    return path


def _joint_of(model: Any, body: int) -> Any:
    """The joint of a body of the arm, None if it is fixed to its parent."""
    first, count = model.body_jntadr[body], model.body_jntnum[body]
    if count > 1 or any(model.jnt_type[j] not in (2, 3) for j in range(first, first + count)):
        raise RobotError(
            f"The body {model.body(body).name} of the arm moves by {count} joints; each body of an arm has one hinge "
            "or slide, or none."
        )
    return model.joint(first) if count else None


def add_joint(
    robot: ET.Element,
    name: str,
    kind: str,
    ends: tuple[str, str],
    pose: FloatArray,
    axis: Any = (0, 0, 1),
    limits: Sequence[float] = (),
    speed: float = 1.0,
) -> None:
    """A URDF joint between two links by name; ``pose`` (4, 4) is the child's in the parent's link."""
    element = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(element, "parent", link=ends[0])
    ET.SubElement(element, "child", link=ends[1])
    ET.SubElement(element, "origin", _origin(pose))
    if kind != "fixed":
        low, high = map(float, limits)
        ET.SubElement(element, "axis", xyz=_text(axis))
        ET.SubElement(element, "limit", lower=str(low), upper=str(high), velocity=str(speed), effort="100")


def _link(robot: ET.Element, ends: tuple[str, str], pose: FloatArray, joint: Any, speed: float) -> None:
    """The joint of the model between two links; None for a fixed one."""
    if joint is None:
        add_joint(robot, f"{ends[1]}_mount", "fixed", ends, pose)
        return
    low, high = joint.range
    if not low < high:
        raise RobotError(f"The joint {joint.name} of the model has no limits; give it a range.")
    kind, axis = {2: "prismatic", 3: "revolute"}[int(joint.type[0])], joint.axis
    if kind == "prismatic" and -low > high:  # two fingers may open by opposite signs: here both open upwards
        low, high, axis = -high, -low, -axis
    add_joint(robot, joint.name, kind, ends, pose, axis, (low, high), speed)


def _add_geometry(link: ET.Element, model: Any, geom: int, link_from_geom: FloatArray) -> None:
    import mujoco

    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    shapes = mujoco.mjtGeom
    if kind == shapes.mjGEOM_MESH:
        shape = ET.Element("mesh", filename=str(mesh_file(model, int(model.geom_dataid[geom]))))
    elif kind == shapes.mjGEOM_BOX:
        shape = ET.Element("box", size=_text(2 * size))
    elif kind == shapes.mjGEOM_SPHERE:
        shape = ET.Element("sphere", radius=str(size[0]))
    elif kind in (shapes.mjGEOM_CYLINDER, shapes.mjGEOM_CAPSULE):
        length = 2 * (size[1] + (size[0] if kind == shapes.mjGEOM_CAPSULE else 0.0))
        shape = ET.Element("cylinder", radius=str(size[0]), length=str(length))
    else:
        return
    collides = model.geom_contype[geom] or model.geom_conaffinity[geom]
    solid = ET.SubElement(link, "collision" if collides else "visual")
    ET.SubElement(solid, "origin", _origin(link_from_geom))
    ET.SubElement(solid, "geometry").append(shape)


def mesh_file(model: Any, mesh: int) -> Path:
    """A mesh of the model, as compiled, as an OBJ file in the cache."""
    made = mesh_of(model, mesh)
    digest = hashlib.sha256(made.vertices.tobytes() + made.faces.tobytes()).hexdigest()[:32]
    path = cache_folder() / "mjcf" / f"{digest}.obj"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_mesh(path, made)
    return path


def mesh_of(model: Any, mesh: int) -> TriangleMesh:
    """A mesh of the model, metres in the geom's frame."""
    first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return TriangleMesh(vertices, model.mesh_face[face : face + model.mesh_facenum[mesh]])


def _origin(pose: FloatArray) -> dict[str, str]:
    return {"xyz": _text(pose[:3, 3]), "rpy": _text(Rotation.from_matrix(pose[:3, :3]).as_euler("xyz"))}


def _text(values: Any) -> str:
    return " ".join(f"{float(v):.9g}" for v in np.ravel(values))
