"""A task as a Gymnasium environment, solved by gvla2's own perceiver and planner, 20 joint targets a second.

    python examples/06_gymnasium.py "lift the yellow cube"

Put a policy of your own where `policy` stands: it gets images, depth and joints, and answers with the next joints
and the width between the fingers. Needs `pip install "gvla2[sim,gym]"`.
"""

import sys

import gymnasium
import numpy as np

from gvla2.planning.contracts import PlanRequest
from gvla2.plugins.registry import load_plugins

# Any installed task: "gvla2.gym:" has Gymnasium import the package that knows them.
env = gymnasium.make("gvla2.gym:gvla2/pick_and_lift-v0", image_size=192, control="joint_position")
raw = env.unwrapped
print(env.action_space, *env.observation_space.items(), sep="\n  ")

TURN = 0.04  # radians that a joint turns in a step, at most
components = load_plugins().build_all(
    {"perceiver": {"name": "classical"}, "planner": {"name": "skill"}}, ("perceiver", "planner")
)


def policy(instruction):
    """Targets from waypoint to waypoint, all from the first look: perceive, plan, and go straight in joint space."""
    seen, arm = raw.observation, raw.arm
    scene = components["perceiver"].perceive(seen, instruction, arm.workspace)
    request = PlanRequest(instruction, scene, arm, seen.world_from_tcp, seen.joints, seen)
    plan = components["planner"].plan(request)
    if plan.trajectory is None:
        sys.exit(f"No plan ({plan.abstention.kind}): {plan.abstention.message}")
    joints = seen.joints
    for pose, waypoint in zip(plan.trajectory.poses(seen.world_from_tcp), plan.trajectory, strict=True):
        goal = arm.inverse(pose, joints).joints
        steps = max(20, int(np.abs(goal - joints).max() / TURN))  # the fingers take up to a second and a half
        for target in np.linspace(joints, goal, steps):
            yield waypoint.stage, np.append(target, waypoint.gripper * arm.hand.max_width)
        joints = goal


wish = {"instruction": sys.argv[1]} if len(sys.argv) > 1 else {}
_, info = env.reset(seed=0, options=wish)
print(f'"{info["instruction"]}"')

stage = ""
for doing, action in policy(info["instruction"]):
    if doing != stage:
        stage = doing
        print(f"  {stage}")
    observation, reward, terminated, truncated, info = env.step(action)
    if terminated or truncated:
        break

print("Success:", info["success"])
env.close()
