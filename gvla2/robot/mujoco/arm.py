"""An arm of a compiled MuJoCo model: kinematics, collisions and its own pixels follow from the model alone."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gvla2.errors import RobotError, reading
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.robot.arm_from_urdf import ArmDescription, RobotModel, build_arm
from gvla2.robot.collision import coal_shape, convex_hull
from gvla2.robot.grippers import Gripper
from gvla2.robot.kinematics import Finger, library
from gvla2.robot.looks import CELL, GREY, joined
from gvla2.robot.options import ArmConfig


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


def arm_from_mjcf(model: Any, names: ArmNames, config: ArmConfig, speed: float = 2.0) -> RobotModel:
    """The arm of a compiled model (``mujoco.MjModel``), where it stands in the model's world.

    ``config`` says what a model leaves open: hand, home, workspace and the table's height. MuJoCo knows no limits of
    ``speed``: it is that of all joints, rad/s. Raises :class:`RobotError` for names that the model lacks and for joints
    that an arm cannot have.
    """
    names.check(model)
    with reading("an arm", f"the model of {names.base}", RobotError):
        description = _described(model, names, speed)
    base = description.model.frames[description.model.getFrameId(names.base)].placement.translation
    options = replace(config, tool_link=names.tool, base_position=base.tolist())
    made = build_arm(description, options, np.eye(4))
    order = made.arm.kinematics.joint_names
    if order != names.joints:
        raise RobotError(f"The joints of the arm from its base on are {', '.join(order)}: name them so.")
    return made


def _described(model: Any, names: ArmNames, speed: float) -> ArmDescription:
    """The arm's links: the bodies that move or that ``names`` has, with what is fixed to them. A link collides by its
    geometry that collides and is drawn by the rest, or by all of it where there is one kind.
    """
    import mujoco

    data, pin = mujoco.MjData(model), library("pinocchio")
    for name in (*names.joints, *names.fingers):
        data.joint(name).qpos[0] = 0.0
    mujoco.mj_kinematics(model, data)
    arm, solids = pin.Model(), pin.GeometryModel()
    links: dict[int, _Link] = {}  # by body
    for body in robot_bodies(model, names.base):
        above = links.get(int(model.body_parentid[body]))
        links[body] = _link(arm, model, data, body, above, names, speed)
    geoms = [
        (link, model.body_geomadr[body] + i)
        for body, link in links.items()
        for i in range(model.body_geomnum[body])
    ]
    collides = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    hard = {link.name for link, geom in geoms if collides[geom]}
    drawn = {link.name for link, geom in geoms if not collides[geom]}
    corners: dict[str, list[FloatArray]] = defaultdict(list)
    looks: dict[str, list[Surface]] = defaultdict(list)
    for link, geom in geoms:
        mesh = geom_mesh(model, geom)
        if mesh is None:
            continue
        world_from_geom = rigid(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom])
        link_from_geom = invert_rigid(link.world_from_link) @ world_from_geom
        if collides[geom] or link.name not in hard:
            place = pin.SE3(invert_rigid(link.world_from_joint) @ world_from_geom)
            shape = _solid(model, geom, mesh.vertices)
            solids.addGeometryObject(pin.GeometryObject(link.name, link.joint, link.frame, place, shape))
            corners[link.name].append(transform_points(link_from_geom, mesh.vertices))
        if not collides[geom] or link.name not in drawn:
            coarse = mesh.clustered(CELL)[0] if model.geom_dataid[geom] >= 0 else mesh
            vertices = transform_points(link_from_geom, coarse.vertices)
            looks[link.name].append(Surface(vertices, coarse.faces, np.tile(GREY, (len(coarse.faces), 1)), 0))
    return ArmDescription(
        source=f"the model of {names.base}",
        model=arm,
        solids=solids,
        surfaces={name: joined(surfaces, identity=0) for name, surfaces in looks.items()},
        corners={name: np.concatenate(points) for name, points in corners.items()},
        gripper=_gripper(model, names, links),
    )


@dataclass(frozen=True)
class _Link:
    """A body with what is fixed to it; ``frame`` and ``joint``, that moves it, are pinocchio's numbers."""

    name: str
    frame: int
    joint: int
    world_from_link: FloatArray
    world_from_joint: FloatArray


def _link(
    arm: Any, model: Any, data: Any, body: int, above: _Link | None, names: ArmNames, speed: float
) -> _Link:
    """The link of a body of the robot, added to the pinocchio model ``arm`` unless it is fixed to the one ``above``."""
    pin, name, joint = library("pinocchio"), model.body(body).name or f"body{body}", _joint_of(model, body)
    if above is not None and joint is None and name != names.tool:
        return above
    pose = rigid(data.xmat[body].reshape(3, 3), data.xpos[body])
    number, origin = (0, np.eye(4)) if above is None else (above.joint, above.world_from_joint)
    if joint is not None and joint.name in (*names.joints, *names.fingers):
        if not joint.range[0] < joint.range[1]:
            raise RobotError(f"The joint {joint.name} of the model has no limits; give it a range.")
        kind = pin.JointModelPrismaticUnaligned if _slides(model, joint) else pin.JointModelRevoluteUnaligned
        at = rigid(pose[:3, :3], data.xanchor[joint.id])
        effort, speeds, low, high = (np.array([value]) for value in (100.0, speed, *joint.range))
        place = pin.SE3(invert_rigid(origin) @ at)
        number = arm.addJoint(number, kind(joint.axis), place, joint.name, effort, speeds, low, high)
        arm.addJointFrame(number)
        origin = at
    frame = arm.addBodyFrame(name, number, pin.SE3(invert_rigid(origin) @ pose), 0)
    return _Link(name, frame, number, pose, origin)


def _joint_of(model: Any, body: int) -> Any:
    """The joint of a body of the arm, None if it is fixed to its parent."""
    first, count = model.body_jntadr[body], model.body_jntnum[body]
    if count > 1 or any(model.jnt_type[j] not in (2, 3) for j in range(first, first + count)):
        raise RobotError(
            f"The body {model.body(body).name} of the arm moves by {count} joints; each body of an arm has one hinge "
            "or slide, or none."
        )
    return model.joint(first) if count else None


def _slides(model: Any, joint: Any) -> bool:
    return int(model.jnt_type[joint.id]) == 2


def _gripper(model: Any, names: ArmNames, links: dict[int, _Link]) -> Gripper:
    """The hand; a finger is closed at the end of its joint's range that is nearer to zero, if measuring agrees."""
    joints = [model.joint(name) for name in names.fingers]
    bodies = [int(joint.bodyid[0]) for joint in joints]
    palms = {links[int(model.body_parentid[body])].name for body in bodies}
    if len(joints) != 2 or len(palms) != 1 or not all(_slides(model, joint) for joint in joints):
        raise RobotError(f"The fingers {', '.join(names.fingers)} must be two sliding joints on one body.")
    fingers = [Finger(joint.name, *sorted(map(float, joint.range), key=abs)) for joint in joints]
    return Gripper(palms.pop(), tuple(fingers), tuple(links[body].name for body in bodies))


def _solid(model: Any, geom: int, vertices: FloatArray) -> Any:
    """What collides of a geom with ``vertices`` (N, 3): a round shape, a capsule with flat ends, or a hull."""
    from mujoco import mjtGeom

    kind, (radius, half, _) = model.geom_type[geom], model.geom_size[geom]
    if kind == mjtGeom.mjGEOM_SPHERE:
        return coal_shape("sphere", (2 * radius,) * 3)
    if kind in (mjtGeom.mjGEOM_CYLINDER, mjtGeom.mjGEOM_CAPSULE):
        length = 2 * (half + (radius if kind == mjtGeom.mjGEOM_CAPSULE else 0.0))
        return coal_shape("cylinder", (2 * radius, 2 * radius, length))
    return convex_hull(vertices)


def geom_mesh(model: Any, geom: int) -> TriangleMesh | None:
    """A geom's surface in its own frame, metres; None for a plane and the like."""
    import trimesh
    from mujoco import mjtGeom

    made, size = trimesh.creation, np.asarray(model.geom_size[geom])
    primitives = {
        mjtGeom.mjGEOM_BOX: lambda: made.box(2 * size),
        mjtGeom.mjGEOM_CYLINDER: lambda: made.cylinder(size[0], 2 * size[1]),
        mjtGeom.mjGEOM_CAPSULE: lambda: made.capsule(2 * size[1], size[0]),
        mjtGeom.mjGEOM_SPHERE: lambda: made.icosphere(radius=size[0]),
        mjtGeom.mjGEOM_ELLIPSOID: lambda: made.icosphere().apply_scale(size),
    }
    kind = mjtGeom(model.geom_type[geom])
    if kind in primitives:
        shape = primitives[kind]()
        return TriangleMesh(shape.vertices, shape.faces)
    if kind != mjtGeom.mjGEOM_MESH:
        return None
    mesh = int(model.geom_dataid[geom])
    first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return TriangleMesh(vertices, model.mesh_face[face : face + model.mesh_facenum[mesh]])
