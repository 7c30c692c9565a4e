"""Stresses in which the governance of a memory may matter: what each changes in the arms' experience.

Their numbers were fixed before any arm was measured. None of them sees an arm or a result.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from typing import Any

import numpy as np

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError
from gvla2.evaluation.arms import BenchArm, Story
from gvla2.evaluation.components import options_of
from gvla2.evaluation.config import STRESSES, RobotBench
from gvla2.memory.contracts import Lesson, Memory, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.late import LateMemory
from gvla2.planning.colours import COLOURS
from gvla2.planning.effects import Prior
from gvla2.plugins.registry import Registry
from gvla2.robot.task import HasHearsay
from gvla2.skills.table import STANDARD

WRONG, WITHHELD = 0.2, 0.5
"""The share of the verifier's sure verdicts that are wrong, and that nobody hears."""
HEARD, CLAIMED = 30, 10
"""Number of imported lessons, every second one wrong, and how many successes the first claims; each claims one more."""
CROWD, BUDGET = 2000, 50
"""Number of lessons of other tasks, and of active records that a bank with a budget keeps."""
OTHER_SKILLS = ("pick", "place", "push", "insert", "draw", "close")
"""Skills that no task of the learnable world needs."""
BUILDS = [f"{build}{size}" for build, size in product(("", "tall ", "flat "), ("tiny", "small", "medium"))]
SOURCE = "a colleague's notes"


def stresses_of(config: RobotBench) -> frozenset[str]:
    """The stresses of a design, whose configuration has at most one name: "none", "all", or some joined by "+"."""
    names = {one for stress in config.stresses for one in stress.split("+")}
    return frozenset(STRESSES[:5] if "all" in names else names & {*STRESSES})


def lived(config: RobotBench, registry: Registry) -> RobotBench:
    """The configuration of exploration, and of the banks: with its planner, and the verifier that the stresses make."""
    if config.exploration_planner:
        planner, _ = registry.configure({"planner": {"name": config.exploration_planner}}, "planner")
        config = replace(config, planner=planner)
    stresses = stresses_of(config)
    shares = {"rate": WRONG * ("verifier" in stresses), "withheld": WITHHELD * ("unjudged" in stresses)}
    if not any(shares.values()):
        return replace(config, stresses=[])
    inner: ComponentConfig = config.verifier
    options = {name: value for name, value in asdict(inner).items() if name != "name"}
    flaky = {"name": "flaky", "inner": inner.name, "options": options, **shares}
    verifier, _ = registry.configure({"verifier": flaky}, "verifier")
    return replace(config, stresses=[], verifier=verifier)


def in_world(task: Mapping[str, Any], stresses: frozenset[str]) -> dict[str, Any]:
    """A task's options in the world of these stresses, as it is in the end."""
    changed = {"drifted": "drift" in stresses, "twins": "twins" in stresses}
    return {**task, **{name: True for name, given in changed.items() if given}}


def crowd(known: Iterable[Story]) -> list[Story]:
    """Successes of other tasks, which teach 2,000 lessons in the words of our own, three an episode; their verdicts are
    drawn from the ``known`` ones.
    """
    rng = np.random.default_rng(CROWD)
    good = [verdict for _, verdict in known if verdict.outcome == "verified_success"]
    verdicts = good or [Verdict.from_criteria({"task_completion": 1.0})]
    kinds = list(product(OTHER_SKILLS, BUILDS, COLOURS, ("box", "cylinder", "disc", "object")))
    stories: list[Story] = []
    for number, kind in enumerate(rng.permutation(len(kinds))[: -(-CROWD // 3)].tolist()):
        name, build, colour, shape = kinds[kind]
        skill = STANDARD[name]
        lessons = tuple(
            Lesson(
                "procedural_hint",
                f"{skill.words} a {build} {colour} {shape} from the top: this {key.replace('_', ' ')} succeeded.",
                Prior(key, float(rng.uniform(0.005, 0.1)), count=1, skill=name, object=colour).to_json(),
            )
            for key in (skill.key or ("standoff", "transit_clearance", "speed"))[:3]
        )
        task = MemoryTask(f"{name} the {colour} {shape}", skill=name)
        told = "Executed:\n- 0 approach: 1 mm off\n- 1 close: 1 mm off, holding\n- 2 lift: 1 mm off, holding"
        verdict = verdicts[int(rng.integers(len(verdicts)))]
        stories.append((MemoryEpisode(task, lessons, told, source=f"other-{number}"), verdict))
    return stories


def with_budget(arm: BenchArm, registry: Registry) -> BenchArm:
    """The arm with the budget of a crowded bank, if its memory has one."""
    if "active_budget" not in options_of(registry, "memory", arm.memory):
        return arm
    return replace(arm, options={"active_budget": BUDGET, **arm.options})


def hear(memory: Memory, said: Iterable[Story]) -> None:
    """Give a memory lessons from outside: as an import does, where it can tell them from its own experience, else as
    episodes.
    """
    for episode, verdict in said:
        if isinstance(memory, LateMemory):
            memory.admit(episode.lessons[0], verdict, task=episode.task, source=episode.source)
        else:
            memory.learn(episode, verdict)


def hearsay(
    rows: Mapping[str, Mapping[str, Any]],
    stories: Mapping[str, Sequence[Story]],
    registry: Registry,
    seed: int,
) -> list[Story]:
    """The lessons that a colleague hands over: about each row's family in turn, every second one wrong.

    All are as confident, name the object as our own lessons do, and claim to be verified.
    """
    rng = np.random.default_rng([seed, HEARD])
    sure = Verdict.from_criteria({"task_completion": 1.0}, verifier="import")
    found: list[Story] = []
    for number in range(HEARD):
        # A round through the rows, then the next: a row gets right and wrong ones.
        place = number % len(rows)
        subject = list(rows)[place]
        task = inspect.unwrap(registry.build({"task": dict(rows[subject])}, "task"))
        if not isinstance(task, HasHearsay):
            raise ConfigurationError(
                f"Nobody talks about the task '{rows[subject]['name']}': it hides nothing."
            )
        one = task.hearsay(rng, wrong=bool((number // len(rows) + place) % 2))
        look = _look(stories.get(subject, ()), one.skill, one.parameter)
        count = CLAIMED + number
        effect = Prior(one.parameter, one.value, count=count, skill=one.skill, object=look).to_json()
        words = f"To {one.sentence}, the {one.parameter.replace('_', ' ')} must be {one.value:.3g}."
        lesson = Lesson("procedural_hint", f"{words} Certain: tried {count} times, it never failed.", effect)
        found.append(
            (MemoryEpisode(MemoryTask(one.sentence, skill=one.skill), (lesson,), source=SOURCE), sure)
        )
    return found


def _look(stories: Iterable[Story], skill: str, parameter: str) -> str:
    """The look of the object that lessons about this parameter name."""
    effects = (lesson.effect or {} for episode, _ in stories for lesson in episode.lessons)
    about = (e for e in effects if (e.get("skill"), e.get("parameter")) == (skill, parameter))
    return next((str(effect["object"]) for effect in about if effect.get("object")), "")
