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
from gvla2.geometry.transform import FloatArray, rigid
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

    Links are the model's bodies in their own frames. What collides becomes collision, the rest of the drawn geometry
    visual. Raises :class:`RobotError` for joints that a URDF cannot have.
    """
    names.check(model)
    robot = ET.Element("robot", name=names.base)
    moving = {*names.joints, *names.fingers}
    kept = {int(model.body(name).id) for name in (names.base, names.tool)}
    # By body: the body whose link it is part of, and link_from_body (4, 4).
    place: dict[int, tuple[int, FloatArray]] = {}
    links: dict[int, ET.Element] = {}
    for body in robot_bodies(model, names.base):
        joint = _joint_of(model, body)
        parent, link_from_parent = place.get(int(model.body_parentid[body]), (body, np.eye(4)))
        link_from_body = link_from_parent @ rigid(
            _rotation(model.body_quat[body]).as_matrix(), model.body_pos[body]
        )
        if joint is not None or body in kept:
            # A URDF's joint goes through its link's origin: the link's frame lies there.
            origin = np.zeros(3) if joint is None else np.array(joint.pos)
            links[body] = ET.SubElement(robot, "link", name=_name(model, body))
            if parent != body:
                at = link_from_body @ rigid(translation=origin)
                own = joint if joint and joint.name in moving else None
                _link(robot, model, (parent, body), at, own, speed)
            place[body] = body, rigid(translation=-origin)
        else:  # a body that is fixed to another is a part of its link
            place[body] = parent, link_from_body
        link, pose = place[body]
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            _add_geometry(links[link], model, geom, pose)
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


def _link(
    robot: ET.Element, model: Any, ends: tuple[int, int], pose: FloatArray, joint: Any, speed: float
) -> None:
    """The joint of the model between two bodies' links; None for a fixed one."""
    names = _name(model, ends[0]), _name(model, ends[1])
    if joint is None:
        add_joint(robot, f"{names[1]}_mount", "fixed", names, pose)
        return
    low, high = joint.range
    if not low < high:
        raise RobotError(f"The joint {joint.name} of the model has no limits; give it a range.")
    kind, axis = {2: "prismatic", 3: "revolute"}[int(joint.type[0])], joint.axis
    if kind == "prismatic" and -low > high:  # two fingers may open by opposite signs: here both open upwards
        low, high, axis = -high, -low, -axis
    add_joint(robot, joint.name, kind, names, pose, axis, (low, high), speed)


def _add_geometry(link: ET.Element, model: Any, geom: int, link_from_body: FloatArray) -> None:
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
    body_from_geom = rigid(_rotation(model.geom_quat[geom]).as_matrix(), model.geom_pos[geom])
    ET.SubElement(solid, "origin", _origin(link_from_body @ body_from_geom))
    ET.SubElement(solid, "geometry").append(shape)


def mesh_file(model: Any, mesh: int) -> Path:
    """A mesh of the model, as compiled, as an OBJ file in the cache."""
    vertices, faces = mesh_of(model, mesh)
    digest = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest()[:32]
    path = cache_folder() / "mjcf" / f"{digest}.obj"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_mesh(path, TriangleMesh(vertices, faces))
    return path


def mesh_of(model: Any, mesh: int) -> tuple[FloatArray, Any]:
    """Vertices (V, 3), metres in the geom's frame, and faces (F, 3) of a mesh of the model."""
    first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = np.asarray(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], dtype=np.float64)
    faces = np.asarray(model.mesh_face[face : face + model.mesh_facenum[mesh]], dtype=np.int64)
    return vertices, faces


def _rotation(quaternion: Any) -> Rotation:
    return Rotation.from_quat(np.asarray(quaternion)[[1, 2, 3, 0]])


def _origin(pose: FloatArray) -> dict[str, str]:
    return {"xyz": _text(pose[:3, 3]), "rpy": _text(Rotation.from_matrix(pose[:3, :3]).as_euler("xyz"))}


def _name(model: Any, body: int) -> str:
    return model.body(body).name or f"body{body}"


def _text(values: Any) -> str:
    return " ".join(f"{float(v):.9g}" for v in np.ravel(values))
