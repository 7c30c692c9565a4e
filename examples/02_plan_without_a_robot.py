"""From a sentence and two cubes to waypoints: the `skill` planner alone, without simulator and robot.

python examples/02_plan_without_a_robot.py "lift the blue cube"
"""

import sys

from gvla2.planning.checks import check_trajectory
from gvla2.plugins.registry import load_plugins
from gvla2.testing.inputs import plan_request

instruction = sys.argv[1] if len(sys.argv) > 1 else "lift the red cube"

# Any mapping, dataclass or composed Hydra configuration with a field for the kind will do.
planner = load_plugins().build({"planner": {"name": "skill"}}, "planner")

# A table with a red and a blue cube, as a flawless perceiver would report it, under a gantry.
request = plan_request(instruction)
for obj in request.scene.objects:
    print(f"I see a {obj.label} at {obj.centre.round(3)}")

plan = planner.plan(request)
print(f'"{instruction}": skill {plan.skill or "-"}, roles {dict(plan.roles)}')
if plan.trajectory is None:
    print(f"I do nothing ({plan.abstention.kind}): {plan.abstention.message}")
    sys.exit()

for waypoint in plan.trajectory:
    x, y, z = waypoint.xyz
    print(f"  {waypoint.stage:<12} x {x:+.3f}  y {y:+.3f}  z {z:.3f}  gripper {waypoint.gripper:.2f}")

report = check_trajectory(plan.trajectory, request.scene, request.arm, request.start, request.joints)
print("All checks pass." if report.passed else "\n".join(report.reasons))
