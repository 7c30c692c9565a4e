"""The questions about an episode: the paper's criteria for robots and for software agents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from types import MappingProxyType

from gvla2.errors import ConfigurationError


@dataclass(frozen=True)
class Criterion:
    """``name`` is the key in a verdict's criteria; ``question`` says what deserves the best score."""

    name: str
    question: str


ROBOT = (
    Criterion(
        "task_completion",
        "Is the state that the instruction asks for reached at the end? Judge by what was observed after the motion, "
        "not by what was planned. Tidy motion that misses the goal deserves the worst score.",
    ),
    Criterion(
        "spatial_consistency",
        "Do positions, sizes and distances agree with one another throughout: the perceived scene, the planned "
        "waypoints, the places reached, and the scene afterwards? Bystanders that moved count against it.",
    ),
    Criterion(
        "collision_safety",
        "Did the robot touch only what it was meant to touch, with clearance elsewhere? A collision, an emergency "
        "stop or an unplanned contact deserves a bad score even when the task was completed.",
    ),
    Criterion(
        "execution_validity",
        "Was the whole plan carried out as planned: every waypoint reached within its tolerance, the gripper opening "
        "and closing as asked, no abort, no missing stage?",
    ),
    Criterion(
        "generalizability",
        "Would the same approach work again with the things elsewhere, a little larger or of another colour? Luck, "
        "repairs on the way and numbers that fit this one scene alone count against it.",
    ),
)

SOFTWARE = (
    Criterion(
        "root_cause",
        "Was the cause of the problem found and treated, rather than its symptom? Special cases, silenced errors and "
        "guesses without a look at the code count against it.",
    ),
    Criterion(
        "code_quality",
        "Is the change correct in the cases nearby, no larger than needed, readable, and in keeping with the code "
        "around it? Debris, broken interfaces and disabled checks count against it.",
    ),
    Criterion(
        "empirical_verification",
        "Was the result shown by running something: the failure reproduced before and gone after, tests run and "
        "passed? Claims without output in the transcript deserve a bad score.",
    ),
)

SETS: Mapping[str, tuple[Criterion, ...]] = MappingProxyType({"robot": ROBOT, "software": SOFTWARE})


def criteria_set(name: str, questions: Mapping[str, str] | None = None) -> tuple[Criterion, ...]:
    """The set of that name; or the user's own ``questions`` (name to question) if given.

    Raises :class:`ConfigurationError` for an unknown set, or an empty name or question.
    """
    if questions:
        for key, question in questions.items():
            if not key.strip() or not question.strip():
                raise ConfigurationError("A criterion of your own needs a name and a question; one is empty.")
        return tuple(Criterion(key, question) for key, question in questions.items())
    if name in SETS:
        return SETS[name]
    close = get_close_matches(name, SETS, n=1)
    hint = f" Did you mean '{close[0]}'?" if close else ""
    raise ConfigurationError(
        f"No set of criteria is called '{name}'.{hint} Sets: {', '.join(SETS)}; or give questions of your own."
    )
