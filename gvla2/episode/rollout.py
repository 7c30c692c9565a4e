"""The stage ``execute`` of an episode in which a policy drives: nothing is perceived, planned or checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.errors import ConfigurationError
from gvla2.robot.backend import ExecutionListener, Moment, RobotBackend
from gvla2.robot.driver import Servo
from gvla2.robot.policy import Policy, Rollout


def roll_out(
    record: EpisodeRecord, policy: Policy, robot: RobotBackend, listener: ExecutionListener
) -> EpisodeRecord:
    """Let the policy drive until the success check finds the goal reached, or its time is over.

    The listener's frames are the first camera's pictures. Raises :class:`ConfigurationError` for a
    robot that a policy cannot drive, and for actions of another arm.
    """
    if not isinstance(robot, Servo):
        raise ConfigurationError(
            f"The robot {type(robot).__name__} takes no joint targets from a policy: choose a simulated one."
        )
    policy.begin(record.instruction)
    most, dof, reached, step = robot.arm.hand.max_width, len(robot.arm.home), False, 0
    first = seen = robot.observe()
    for step in range(1, 1 + round(policy.seconds * policy.rate)):
        goal = np.asarray(policy.act(seen), dtype=np.float64)
        if goal.shape != (dof + 1,) or not np.isfinite(goal).all():
            raise ConfigurationError(
                f"An action for this arm is {dof} joints and the fingers' width, all finite; the policy "
                f"{policy.source} gave {goal.tolist()}."
            )
        state = robot.servo(goal[:-1], float(np.clip(goal[-1] / most, 0.0, 1.0)), 1.0 / policy.rate)
        seen = robot.observe()
        listener.moment(Moment(step / policy.rate, state.joints, state.gripper_width, command=goal))
        listener.frame(seen.views[0].image)
        if robot.reached():  # passing through a goal does not count
            check = robot.success_check()
            reached = check is not None and check.relaxed
        if reached:
            break
    record = replace(record, observation=first, after=seen, rollout=Rollout(policy.source, policy.rate, step))
    if reached:
        return record
    message = f"The policy has not reached the goal in {step} actions, {step / policy.rate:g} s."
    return replace(record, failure=Failure("execute", "goal_not_reached", message))
