"""The table of standard skills.

Nothing heavy is imported before a skill is used: ``gvla2 plugins`` shows the table at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from gvla2.planning.calls import OPTION_RANGES
from gvla2.planning.skill import Parameter, Role, Skill
from gvla2.skills import parameters

if TYPE_CHECKING:
    from gvla2.planning.arm import Hand
    from gvla2.planning.contracts import Abstention
    from gvla2.planning.scene import Scene, SceneObject
    from gvla2.planning.skill import Job, Outcome, Proposal, Signal

_SIDES = ("beside", "left_of", "right_of", "behind", "front_of")
_ONTO = ("on", "in", "to", *_SIDES)

PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        p.name: p
        for p in (
            Parameter(
                "standoff", "m", "gap between hand and object before the last, straight part", 0.0, 0.2
            ),
            Parameter("approach_tilt", "rad", "lean of the approach from straight down", 0.0, 1.57),
            Parameter("grasp_depth", "m", "from the top (or front) of the object to the tool", 0.0, 0.3),
            Parameter("grasp_fraction", "", "where along its longer side it is grasped, 0 to 1", 0.0, 1.0),
            Parameter("lift_height", "m", "how far it is lifted", *OPTION_RANGES["lift_height"][:2]),
            Parameter(
                "transit_clearance", "m", "gap between what is carried and the highest object", 0.0, 0.3
            ),
            Parameter("place_height", "m", "gap under the object when the hand opens", 0.0, 0.1),
            Parameter(
                "turn", "rad", "by how much a cap is turned, against the clock from above", -6.28, 6.28
            ),
            Parameter("insert_depth", "m", "how far the hole goes over a post before release", 0.0, 0.2),
            Parameter("push_height", "m", "gap between fingertips and table while pushing", 0.0, 0.2),
            Parameter("push_overshoot", "m", "how far beyond the goal it is pushed", -0.1, 0.1),
            Parameter("press_depth", "m", "how far below a button's top the fingertips go", 0.0, 0.03),
            Parameter("press_seconds", "s", "how long a button is held down", 0.0, 5.0),
            Parameter("lip_depth", "m", "how far inside a lid's free edge it is grasped", 0.0, 0.03),
            Parameter("open_angle", "rad", "how far a lid is swung open, from closed", 0.2, 3.0),
            Parameter("hook_depth", "m", "how far below a lid's free edge the fingers hook", 0.0, 0.05),
            Parameter("let_go_angle", "rad", "opening from which a lid falls shut by itself", 0.0, 2.0),
            Parameter("pull_distance", "m", "how far it is pulled (or drawn beyond being free)", 0.0, 0.4),
            Parameter(
                "unlatch_lift", "m", "how far a handle is lifted, held, before it is pulled", 0.0, 0.04
            ),
            Parameter("end_distance", "m", "how far from its free end it is held", 0.0, 0.1),
            Parameter("speed", "m/s", "of the tool in the open", *OPTION_RANGES["speed"][:2]),
            Parameter(
                "contact_speed", "m/s", "of the tool where it touches", *OPTION_RANGES["contact_speed"][:2]
            ),
        )
    }
)
"""All parameters of the standard skills, by name."""

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


def _numbers(*names: str) -> tuple[Parameter, ...]:
    return tuple(PARAMETERS[name] for name in (*names, "speed", "contact_speed"))


def _standard(name: str, *, diagnosed: bool = True, **rest: Any) -> Skill:
    fits = partial(_fits, name)
    return Skill(name, propose=_propose, fits=fits, diagnose=_diagnose if diagnosed else None, **rest)


_SKILLS = (
    _standard(
        "pick", defaults=parameters.of_pick, diagnosed=False,
        description="take hold of an object and lift it, also out of what it stands in; amount: how high",
        roles=(Role("theme", "what is lifted; a part stands for its whole"),),
        parameters=_numbers(*_GRASP, "lift_height"),
        words="Pick up (grasp, grab, take, lift, raise)",
        key=("grasp_depth", "approach_tilt", "standoff"),
        scaled={"grasp_depth": "height"}, amount="lift_height", whole=True,
    ),
    _standard(
        "place", defaults=parameters.of_place, diagnosed=False,
        description="pick an object up and put it down on, in or beside the goal, at xy, or some distance away",
        roles=(
            Role("theme", "what is put there; a part stands for its whole"),
            Role("goal", "what it is put on, in or beside", relations=_ONTO),
        ),
        parameters=_numbers(*_GRASP, *_CARRY),
        words="Place (put, set down on or into a goal)",
        key=("place_height", "grasp_depth", "transit_clearance"),
        scaled={"grasp_depth": "height"}, free=True, whole=True,
    ),
    _standard(
        "push", defaults=parameters.of_push,
        description="push an object along the table to the goal, to xy, or by an amount in a direction",
        roles=(
            Role("theme", "what is pushed"),
            Role("goal", "a painted patch, or an object to push it against", relations=("to", "on", "in", *_SIDES)),
        ),
        parameters=_numbers("standoff", "push_height", "push_overshoot"),
        words="Push (slide, shove, move to a goal)",
        key=("push_overshoot", "push_height", "standoff"),
        scaled={"push_height": "height"}, free=True, whole=True,
    ),
    _standard(
        "press", defaults=parameters.of_press,
        description="press a button or switch straight down, such as a lamp's",
        roles=(Role("theme", "the button, or the object that it is the only button of"), Role("part", "the button")),
        parameters=_numbers("standoff", "press_depth", "press_seconds"),
        words="Press (push down, switch or turn on)",
        key=("press_depth", "press_seconds", "standoff"), scaled={"press_depth": "height"},
    ),
    _standard(
        "twist", defaults=parameters.of_twist,
        description="unscrew a cap or lid from a bottle or jar and lift it, or put it down at the goal",
        roles=(
            Role("theme", "the cap, or the bottle or jar that it closes"),
            Role("goal", "where the cap is put", required=False, relations=_ONTO),
        ),
        parameters=_numbers(*_GRASP, *_CARRY, "turn", "lift_height"),
        words="Twist (turn, unscrew, open, take off a cap)",
        key=("turn", "grasp_depth", "standoff"),
        scaled={"grasp_depth": "height"}, amount="lift_height", free=True, held_back=True,
        lasting=("turn",),
    ),
    _standard(
        "insert", defaults=parameters.of_insert,
        description="lower an object with a hole over a post",
        roles=(Role("theme", "the object with the hole"), Role("goal", "the post", relations=("on", "in", "to"))),
        parameters=_numbers(*_GRASP, *_CARRY, "insert_depth"),
        words="Insert (put, slide, thread over a post)",
        key=("insert_depth", "grasp_depth", "transit_clearance"),
        scaled={"grasp_depth": "height", "insert_depth": "height"}, whole=True,
    ),
    _standard(
        "open", defaults=parameters.of_open,
        description="open a box by its lid, a drawer by its handle, a jar or bottle by its cap",
        roles=(Role("theme", "what is opened, or its lid"),),
        parameters=_numbers("standoff", "lip_depth", "open_angle"),
        words="Open (swing, lift, flip up a lid)",
        key=("open_angle", "lip_depth", "standoff"),
    ),
    _standard(
        "close", defaults=parameters.of_close,
        description="swing an open lid shut",
        roles=(Role("theme", "the box, or its lid"),),
        parameters=_numbers("standoff", "hook_depth", "let_go_angle"),
        words="Close (shut, swing or fold down a lid)",
        key=("let_go_angle", "hook_depth", "standoff"),
    ),
    _standard(
        "pull", defaults=parameters.of_pull,
        description="pull a drawer open by its handle; amount: how far",
        roles=(Role("theme", "the drawer, its handle or its cabinet"),),
        parameters=_numbers("standoff", "grasp_depth", "unlatch_lift", "pull_distance"),
        words="Pull (draw, slide out, open a drawer)",
        key=("pull_distance", "unlatch_lift", "grasp_depth"),
        amount="pull_distance", held_back=True,
    ),
    _standard(
        "draw", defaults=parameters.of_draw, diagnosed=False,
        description="draw an object that is stuck between others out by its free end, and put it down at the goal",
        roles=(
            Role("theme", "what is stuck"),
            Role("goal", "where it is put", required=False, relations=_ONTO),
        ),
        parameters=_numbers("standoff", "grasp_depth", "end_distance", "pull_distance", *_CARRY),
        words="Draw out (extract, pull out, take from between)",
        key=("grasp_depth", "end_distance", "pull_distance"),
        scaled={"grasp_depth": "height"}, free=True, implied=True,
    ),
)  # fmt: skip

STANDARD: Mapping[str, Skill] = MappingProxyType({skill.name: skill for skill in _SKILLS})
"""The standard skills by name: the default table of a request."""
