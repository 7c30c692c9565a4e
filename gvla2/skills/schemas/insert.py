"""Insert: put an object with a hole over a post: align, lower, let go.

The fingers close on two opposite sides, which centres the hole between them.
"""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import ROUND, SceneObject
from gvla2.planning.trajectory import Guard, Trajectory
from gvla2.skills.proposals import Job, Path, Proposal
from gvla2.skills.schemas.pick import Grasp, grasps, let_go
from gvla2.skills.schemas.place import brought

LEAST_ROOM = 0.001
"""A hole that fits is wider than the post by this much at least, metres."""
BOTTOM = Guard(force=20.0)
"""Lowering ends on contact with the bottom, or with the post's end beside the hole: more force would jam it."""
FREE_TURNS = (0.0, 0.5 * np.pi, -0.5 * np.pi, np.pi)


def fits_over(thing: SceneObject, post: SceneObject) -> bool:
    """Whether a flat object's hole is wider than a post that is taller than the object."""
    flat = thing.extents[2] < 0.6 * float(thing.extents[:2].min())
    slim = float(np.sort(post.extents[:2])[1]) + LEAST_ROOM < thing.opening
    return flat and thing.opening > 0.0 and slim and post.extents[2] > thing.extents[2]


def propose_insert(job: Job) -> list[Proposal] | Abstention:
    """Each grasp from above with each turn that aligns the hole with the post."""
    if job.goal is None or not fits_over(job.theme, job.goal):
        what = "anything" if job.goal is None else f"the {job.goal.label}"
        return Abstention("other", f"The {job.theme.label} has no hole that fits over {what}.")
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    turns = aligning_turns(job.theme, job.goal)
    return [_insert(job, grasp, job.goal, turn) for grasp in found if grasp.family == "top" for turn in turns]


def aligning_turns(theme: SceneObject, post: SceneObject) -> list[float]:
    """Turns about the vertical, radians, that make the hole's sides parallel to the post's; smallest first."""
    if post.shape in ROUND or theme.shape in ROUND:
        return list(FREE_TURNS)
    (a, b) = (float(np.arctan2(o.world_from_object[1, 0], o.world_from_object[0, 0])) for o in (theme, post))
    turns = [float((b - a + quarter + np.pi) % (2 * np.pi) - np.pi) for quarter in FREE_TURNS]
    return sorted(turns, key=abs)


def _insert(job: Job, grasp: Grasp, post: SceneObject, turn: float) -> Proposal:
    def way() -> Trajectory:
        path, over = brought(job, grasp, post.centre, turn)
        lower_over(job, path, grasp, over.centre)
        return path.trajectory()

    how = f"{grasp.description}; over the {post.label}, turned {np.degrees(turn):.0f}°"
    preference = grasp.preference - 0.05 * abs(turn) / np.pi
    return Proposal(how, grasp.approaches, preference, way)


def lower_over(job: Job, path: Path, grasp: Grasp, above: FloatArray) -> None:
    """From ``above`` (3,), with the theme's hole over the goal, a post: align, lower, let go, retreat."""
    theme, post = job.theme, job.goal
    assert post is not None
    hangs = grasp.centre[2] - theme.bottom
    touching = job.own() | job.scene.family(post.id)
    down = np.array([*above[:2], max(post.top - job.theta["insert_depth"] + hangs, job.lowest_tcp())])
    path.line("align", np.array([*above[:2], post.top + 0.01 + hangs]), allowed=touching)
    path.line("insert", down, allowed=touching, slow=True, guard=BOTTOM)
    let_go(path, down, above, grasp.opening, touching)
