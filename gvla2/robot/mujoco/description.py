"""An arm of a compiled MuJoCo model as a URDF: kinematics, collisions and its own pixels follow from it."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
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

EFFORT = "100"
"""Of a joint in the URDF, which needs some; nothing here reads it."""


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
        bodies = [model.body(i).name for i in range(model.nbody)]
        joints = [model.joint(i).name for i in range(model.njnt)]
        for what, names, there in (
            ("bodies", (self.base, self.tool), bodies),
            ("joints", (*self.joints, *self.fingers), joints),
        ):
            missing = [name for name in names if name not in there]
            if missing or not all(names):
                raise RobotError(
                    f"The model has no {what} {missing or list(names)}, by which its arm would be driven. It has: "
                    f"{', '.join(filter(None, there))}."
                )


def robot_bodies(model: Any, base: str) -> list[int]:
    """Indices of the bodies of the tree that begins at ``base``, parents first."""
    mine = [int(model.body(base).id)]
    for body in range(mine[0] + 1, model.nbody):
        if model.body_parentid[body] in mine:
            mine.append(body)
    return mine


def world_from_base(model: Any, data: Any, names: ArmNames) -> FloatArray:
    """(4, 4) of the arm's base body now."""
    base = data.body(names.base)
    return rigid(base.xmat.reshape(3, 3), base.xpos)


def write_urdf(model: Any, names: ArmNames, speed: float) -> Path:
    """A URDF of the arm with its hand, in the cache; ``speed`` is the limit of its joints, rad/s.

    Links are the model's bodies in their own frames. What collides becomes collision, the rest of the drawn geometry
    visual. Raises :class:`RobotError` for joints that a URDF cannot have.
    """
    names.check(model)
    robot = ET.Element("robot", name=names.base)
    moving = {*names.joints, *names.fingers}
    shift = {int(model.body(names.base).id): np.zeros(3)}
    for body in robot_bodies(model, names.base):
        joints = range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if len(joints) > 1 or any(model.jnt_type[j] not in (2, 3) for j in joints):
            raise RobotError(
                f"The body {model.body(body).name} of the arm moves by {len(joints)} joints; each body of an arm has "
                "one hinge or slide, or none."
            )
        # A URDF's joint goes through its link's origin: the link's frame is moved there.
        shift[body] = np.array(model.jnt_pos[joints[0]]) if joints else np.zeros(3)
        link = ET.SubElement(robot, "link", name=_name(model, body))
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            _add_geometry(link, model, geom, shift[body])
        if body == model.body(names.base).id:
            continue
        parent = int(model.body_parentid[body])
        turn = _rotation(model.body_quat[body])
        at = model.body_pos[body] + turn.apply(shift[body]) - shift[parent]
        joint = model.joint(joints[0]) if joints else None
        kind = "fixed" if joint is None or joint.name not in moving else "slide hinge".split()[int(joint.type[0]) - 2]
        element = ET.SubElement(
            robot,
            "joint",
            name=f"{_name(model, body)}_mount" if joint is None else joint.name,
            type={"hinge": "revolute", "slide": "prismatic"}.get(kind, kind),
        )
        ET.SubElement(element, "parent", link=_name(model, parent))
        ET.SubElement(element, "child", link=_name(model, body))
        ET.SubElement(element, "origin", xyz=_text(at), rpy=_text(turn.as_euler("xyz")))
        if joint is not None and kind != "fixed":
            low, high = joint.range
            if not low < high:
                raise RobotError(f"The joint {joint.name} of the model has no limits; give it a range.")
            # Two fingers may open by opposite signs: here both open upwards.
            sign = -1.0 if joint.name in names.fingers and -low > high else 1.0
            low, high = sorted((sign * low, sign * high))
            ET.SubElement(element, "axis", xyz=_text(sign * joint.axis))
            limit = {"lower": str(low), "upper": str(high), "velocity": str(speed), "effort": EFFORT}
            ET.SubElement(element, "limit", limit)
    text = ET.tostring(robot)
    path = cache_folder() / "mjcf" / f"{hashlib.sha256(text).hexdigest()[:32]}.urdf"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    return path


def _add_geometry(link: ET.Element, model: Any, geom: int, shift: FloatArray) -> None:
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
    turn = _rotation(model.geom_quat[geom])
    ET.SubElement(solid, "origin", xyz=_text(model.geom_pos[geom] - shift), rpy=_text(turn.as_euler("xyz")))
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


def _name(model: Any, body: int) -> str:
    return model.body(body).name or f"body{body}"


def _text(values: Any) -> str:
    return " ".join(f"{float(v):.9g}" for v in np.ravel(values))
