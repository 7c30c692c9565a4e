"""The six checks before motion: typed, and all of them reported.

1 schema, 2 workspace, 3 gripper, 4 kinematics, 5 clearance, 6 memory. None of them moves anything, and none stops at
the first fault: a planner that is asked again should get all findings at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Arm
from gvla2.planning.checks_gripper import check_gripper
from gvla2.planning.checks_motion import check_clearance, check_kinematics, resolve_motion
from gvla2.planning.checks_waypoints import check_memory, check_schema, check_workspace
from gvla2.planning.effects import Effect
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory

UNRESOLVED = ("not_finite", "bad_orientation", "wrong_frame", "bad_motion")
"""Faults of waypoints that the arm cannot be asked about."""


def check_trajectory(
    trajectory: Trajectory,
    scene: Scene,
    arm: Arm,
    start_pose: FloatArray,
    start_joints: FloatArray,
    effects: Iterable[Effect] = (),
    parameters: Mapping[str, float] | None = None,
    skill: str = "",
    lengths: Mapping[str, float] | None = None,
) -> CheckReport:
    """The findings on ``trajectory``, started at ``start_pose`` (4, 4) and ``start_joints`` (dof,), radians.

    Each check gives one passed finding, or one failed finding per problem. ``effects`` of kind ``bound`` must hold for
    the plan's ``parameters``; those limited to a skill apply if it is ``skill``, those in shares of a side of the
    handled object if ``lengths`` (metres, by side) give it. A malformed trajectory (not-a-number, no direction) fails
    ``kinematics`` and ``clearance`` as ``unchecked``.
    """
    schema = check_schema(trajectory, scene)
    findings = [*schema, *check_workspace(trajectory, scene, arm, start_pose)]
    findings += check_gripper(trajectory, scene, arm.hand, start_pose)
    if any(f.kind in UNRESOLVED for f in schema):
        reason = "could not be checked: the waypoints are malformed; mend what the schema check names first."
        findings.append(Finding("kinematics", False, -1, "unchecked", f"Kinematics {reason}"))
        findings.append(Finding("clearance", False, -1, "unchecked", f"Clearance {reason}"))
    else:
        legs = resolve_motion(trajectory, scene, arm, start_pose, start_joints)
        findings += check_kinematics(trajectory, legs)
        findings += check_clearance(trajectory, legs, scene, arm)
    findings += check_memory(trajectory, effects, parameters or {}, skill, lengths or {})
    return CheckReport(tuple(findings))
