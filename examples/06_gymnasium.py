"""A task as a Gymnasium environment, solved by gvla2's own perceiver and planner, a waypoint a step.

    python examples/06_gymnasium.py "lift the yellow cube"

Put a policy of your own where `policy` stands: it gets images, depth and joints, and answers with seven numbers.
Needs `pip install "gvla2[sim,gym]"`.
"""

import sys

import gymnasium

from gvla2.planning.contracts import PlanRequest
from gvla2.plugins.registry import load_plugins

# Any installed task: "gvla2.gym:" has Gymnasium import the package that knows them.
env = gymnasium.make("gvla2.gym:gvla2/pick_and_lift-v0", image_size=192)
raw = env.unwrapped
print(env.action_space, *env.observation_space.items(), sep="\n  ")

parts = load_plugins().build_all(
    {"perceiver": {"name": "classical"}, "planner": {"name": "skill"}}, ("perceiver", "planner")
)


def policy(instruction):
    """All waypoints from the first look: perceive, plan, and write each as an action."""
    seen, arm = raw.observation, raw.arm
    scene = parts["perceiver"].perceive(seen, instruction, arm.workspace)
    request = PlanRequest(instruction, scene, arm, seen.world_from_tcp, seen.joints, seen)
    plan = parts["planner"].plan(request)
    if plan.trajectory is None:
        sys.exit(f"No plan ({plan.abstention.kind}): {plan.abstention.message}")
    poses = plan.trajectory.poses(seen.world_from_tcp)
    return [raw.actions.action(pose, w.gripper) for pose, w in zip(poses, plan.trajectory, strict=True)]


wish = {"instruction": sys.argv[1]} if len(sys.argv) > 1 else {}
_, info = env.reset(seed=0, options=wish)
print(f'"{info["instruction"]}"')

for action in policy(info["instruction"]):
    observation, reward, terminated, truncated, info = env.step(action)
    done = info["waypoint"]
    print(f"  {action.round(2)}  {done['abort'] or done['status']}  reward {reward}")
    if terminated or truncated:
        break

print("Success:", info["success"])
env.close()
