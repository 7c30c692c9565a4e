"""The table of standard skills.

Nothing heavy is imported before a skill is used: ``gvla2 plugins`` shows the table at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from gvla2.planning.skill import Role, Skill
from gvla2.skills.parameters import PARAMETERS, defaults

if TYPE_CHECKING:
    from gvla2.planning.arm import Hand
    from gvla2.planning.contracts import Abstention
    from gvla2.planning.scene import Scene, SceneObject
    from gvla2.planning.skill import Job, Outcome, Proposal, Signal

_SIDES = ("beside", "left_of", "right_of", "behind", "front_of")
_ONTO = ("on", "in", "to", *_SIDES)

_GRASP = ("standoff", "approach_tilt", "grasp_depth", "grasp_fraction")
_CARRY = ("transit_clearance", "place_height")


def _propose(job: Job) -> Sequence[Proposal] | Abstention:
    from gvla2.skills.schemas import PROPOSE

    return PROPOSE[job.skill](job)


def _fits(name: str, obj: SceneObject, scene: Scene, hand: Hand) -> bool:
    from gvla2.skills.grounding import FITS

    return FITS[name](obj, scene, hand)


def _diagnose(outcome: Outcome) -> Signal | None:
    from gvla2.skills.diagnosis import DIAGNOSE

    return DIAGNOSE[outcome.plan.skill](outcome)


def _standard(name: str, *numbers: str, diagnosed: bool = True, **rest: Any) -> Skill:
    """The skill with the parameters ``numbers`` and the speeds."""
    names = (*numbers, "speed", "contact_speed")
    return Skill(
        name,
        parameters=tuple(PARAMETERS[each] for each in names),
        propose=_propose,
        defaults=partial(defaults, name, names),
        fits=partial(_fits, name),
        diagnose=_diagnose if diagnosed else None,
        **rest,
    )


_SKILLS = (
    _standard(
        "pick", *_GRASP, "lift_height", diagnosed=False,
        description="take hold of an object and lift it, also out of what it stands in; amount: how high",
        roles=(Role("theme", "what is lifted; a part stands for its whole"),),
        words="Pick up (grasp, grab, take, lift, raise)",
        key=("grasp_depth", "approach_tilt", "standoff"),
        scaled={"grasp_depth": "height"}, amount="lift_height", whole=True,
    ),
    _standard(
        "place", *_GRASP, *_CARRY, diagnosed=False,
        description="pick an object up and put it down on, in or beside the goal, at xy, or some distance away",
        roles=(
            Role("theme", "what is put there; a part stands for its whole"),
            Role("goal", "what it is put on, in or beside", relations=_ONTO),
        ),
        words="Place (put, set down on or into a goal)",
        key=("place_height", "grasp_depth", "transit_clearance"),
        scaled={"grasp_depth": "height"}, free=True, whole=True,
    ),
    _standard(
        "push", "standoff", "push_height", "push_overshoot",
        description="push an object along the table to the goal, to xy, or by an amount in a direction",
        roles=(
            Role("theme", "what is pushed"),
            Role("goal", "a painted patch, or an object to push it against", relations=("to", "on", "in", *_SIDES)),
        ),
        words="Push (slide, shove, move to a goal)",
        key=("push_overshoot", "push_height", "standoff"),
        scaled={"push_height": "height"}, free=True, whole=True,
    ),
    _standard(
        "press", "standoff", "press_depth", "press_seconds",
        description="press a button or switch straight down, such as a lamp's",
        roles=(Role("theme", "the button, or the object that it is the only button of"), Role("part", "the button")),
        words="Press (push down, switch or turn on)",
        key=("press_depth", "press_seconds", "standoff"), scaled={"press_depth": "height"},
    ),
    _standard(
        "twist", *_GRASP, *_CARRY, "turn", "lift_height",
        description="unscrew a cap or lid from a bottle or jar and lift it, or put it down at the goal; turn a knob",
        roles=(
            Role("theme", "the cap, or the bottle or jar that it closes"),
            Role("goal", "where the cap is put", required=False, relations=_ONTO),
        ),
        words="Twist (turn, unscrew, open, take off a cap)",
        key=("turn", "grasp_depth", "standoff"),
        scaled={"grasp_depth": "height"}, amount="lift_height", free=True, held_back=True,
        lasting=("turn",),
    ),
    _standard(
        "insert", *_GRASP, *_CARRY, "insert_depth", diagnosed=False,
        description="lower an object with a hole over a post",
        roles=(Role("theme", "the object with the hole"), Role("goal", "the post", relations=("on", "in", "to"))),
        words="Insert (put, slide, thread over a post)",
        key=("insert_depth", "grasp_depth", "transit_clearance"),
        scaled={"grasp_depth": "height", "insert_depth": "height"}, whole=True,
    ),
    _standard(
        "open", "standoff", "lip_depth", "open_angle", "lever_turn", "pull_distance",
        description="open a box by its lid, a door or drawer by its handle, a jar or bottle by its cap",
        roles=(Role("theme", "what is opened, or its lid"),),
        words="Open (swing, lift, flip up a lid)",
        key=("open_angle", "lip_depth", "standoff"),
    ),
    _standard(
        "close", "standoff", "hook_depth", "let_go_angle", diagnosed=False,
        description="swing an open lid shut, push a drawer or a door shut",
        roles=(Role("theme", "the box, or its lid; the drawer, the door"),),
        words="Close (shut, swing or fold down a lid)",
        key=("let_go_angle", "hook_depth", "standoff"),
    ),
    _standard(
        "pull", "standoff", "grasp_depth", "unlatch_lift", "pull_distance",
        description="pull a drawer open by its handle; amount: how far",
        roles=(Role("theme", "the drawer, its handle or its cabinet"),),
        words="Pull (draw, slide out, open a drawer)",
        key=("pull_distance", "unlatch_lift", "grasp_depth"),
        amount="pull_distance", held_back=True,
    ),
    _standard(
        "draw", "standoff", "grasp_depth", "end_distance", "pull_distance", *_CARRY, diagnosed=False,
        description="draw an object that is stuck between others out by its free end, and put it down at the goal",
        roles=(
            Role("theme", "what is stuck"),
            Role("goal", "where it is put", required=False, relations=_ONTO),
        ),
        words="Draw out (extract, pull out, take from between)",
        key=("grasp_depth", "end_distance", "pull_distance"),
        scaled={"grasp_depth": "height"}, free=True, implied=True,
    ),
)  # fmt: skip

STANDARD: Mapping[str, Skill] = MappingProxyType({skill.name: skill for skill in _SKILLS})
"""The standard skills by name: the default table of a request."""
