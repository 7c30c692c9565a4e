"""Press: closed fingers straight down on a button, wait, and back up."""

from __future__ import annotations

import numpy as np

from gvla2.planning.trajectory import Guard
from gvla2.skills.proposals import Job, Path, Proposal, horizontal, pointing

YAWS = 8

STOP = Guard(force=25.0)
"""A press ends at a button's stop: buttons yield to a few newtons, their stops do not."""


def propose_press(job: Job) -> list[Proposal]:
    """One proposal for each yaw of the closed hand, with and without contact with what the button stands on."""
    proposals = [_press(job, np.pi * k / YAWS, False) for k in range(2 * YAWS)]
    if job.theme.parent:
        proposals += [_press(job, np.pi * k / YAWS, True) for k in range(2 * YAWS)]
    return proposals


def _press(job: Job, yaw: float, touching: bool) -> Proposal:
    theta, theme = job.theta, job.theme
    contact = theme.top + job.hand.tip_beyond_tcp
    above = np.array([*theme.centre[:2], contact + theta["standoff"]])
    down = np.array([*theme.centre[:2], max(contact - theta["press_depth"], job.lowest_tcp())])
    allowed = frozenset({theme.id, theme.parent} if touching else {theme.id})
    path = Path(theta["speed"], theta["contact_speed"], pointing(horizontal(yaw)), gripper=0.0)
    path.go("approach", above, allowed=frozenset({theme.parent}) if touching else frozenset())
    path.line("press", down, allowed=allowed, slow=True, guard=STOP)
    path.line("stay", down, allowed=allowed, slow=True, guard=STOP, dwell=theta["press_seconds"])
    path.line("retreat", above, allowed=allowed)
    how = f"press from above, yaw {np.degrees(yaw):.0f}°" + (", its base may be touched" if touching else "")
    return Proposal(how, ("approach:top",), 0.4 if touching else 0.8, path.trajectory())
