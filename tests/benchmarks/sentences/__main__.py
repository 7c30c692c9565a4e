"""Everyday sentences about fourteen scenes: what a planner takes them to mean, and what it declines.

    python tests/benchmarks/sentences development planner=skill
    python tests/benchmarks/sentences traps planner=code_policies fallback=skill language.model=FILE.gguf
    python tests/benchmarks/sentences SENTENCES.json planner=skill

One scene for each task of the paper, layout 310, as the perceiver sees it. The authors of the sentences saw lists or
pictures of the scenes and knew no grammar. ``development`` (182) is what planners are developed on: a quarter asks for
what cannot be done; ``traps`` (56) must all be declined. Nothing moves: a plan is right if its skills, objects and
goals are among those that the author allowed, and declined if it has no trajectory, whatever the reason.
"""

import json
import sys
from collections import Counter
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import build_components
from gvla2.episode.planning import NamedPlanner, PlannerWithFallback
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import Gvla2Error
from gvla2.evaluation.suites.robot_design import TASKS
from gvla2.planning.part_hierarchy import root_of
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import load_plugins
from gvla2.skills.grounding import Meant, meant

LAYOUT = 310
ACTS = {
    "lift": {"pick", "draw", "pull", "twist"}, "put": {"place", "insert", "draw"}, "push": {"push"}, "press": {"press"},
    "open": {"open", "pull", "twist"}, "close": {"close"}, "unscrew": {"twist"}, "insert": {"insert", "place"},
}  # fmt: skip
"""What the authors' verbs allow."""
TAKEN = {"place": {"lift"}, "draw": {"lift"}, "twist": {"unscrew", "open"}}
"""What a skill that leads somewhere does first."""


def seen(parts):
    """The record of a fresh layout with its scene, before any plan."""
    instance = parts.robot.reset(parts.task, LAYOUT, None)
    observation = parts.robot.observe()
    scene = parts.perceiver.perceive(observation, instance.instruction, parts.robot.arm.workspace)
    return EpisodeRecord("", "", "", LAYOUT, parts.choices, observation=observation, scene=scene)


def acts_of(plan, scene):
    """(skill, thing, goal) of a plan and of what comes after it."""
    themes = [thing for role, thing in plan.roles.items() if role.startswith("theme_")] or [
        plan.roles.get("theme", "")
    ]
    acts = [(plan.skill, thing, plan.roles.get("goal", "")) for thing in themes]
    for call in plan.remaining:
        found = meant(call, scene)
        if isinstance(found, Meant):
            acts.append((found.skill, found.theme.id, found.goal.id if found.goal else ""))
        else:
            acts.append((call.skill, call.theme, call.goal))
    return acts


def is_right(acts, right, scene):
    """Whether the acts are, one by one, among those that are right; a part stands for its whole."""

    def kin(one, other):
        return one == other or (one and other and root_of(scene[one], scene) is root_of(scene[other], scene))

    def done(act, allowed):
        skill, thing, goal = act
        return any(
            skill in ACTS[a["act"]] and kin(thing, a["thing"]) and kin(goal, a["goal"]) for a in allowed
        )

    if (
        len(acts) == 1 and len(right) == 2 and acts[0][2]
    ):  # one that takes a thing and puts it somewhere is both
        skill, thing, _ = acts[0]
        taken = any(a["act"] in TAKEN.get(skill, ()) and kin(thing, a["thing"]) for a in right[0])
        return taken and done(("place", *acts[0][1:]), right[1])
    return len(acts) == len(right) and all(map(done, acts, right))


def outcome(record, row, consultation):
    try:
        plan = consultation.plan(replace(record, instruction=row["sentence"])).plan
        why = plan.abstention.kind if plan.abstention is not None else ""
    except Gvla2Error as error:
        plan, why = None, str(error)[:60]
    if plan is None or plan.trajectory is None:
        return ("rightly declined" if not row["right"] else "declined"), why
    acts = acts_of(plan, record.scene)
    return ("right" if is_right(acts, row["right"], record.scene) else "wrong"), acts


def main() -> None:
    from hydra import compose, initialize_config_module
    from omegaconf import OmegaConf

    name, *overrides = sys.argv[1:]
    file = Path(name) if name.endswith(".json") else Path(__file__).parent / f"{name}.json"
    rows = json.loads(file.read_text())
    registry = load_plugins()
    register(registry, schemas())
    counted: Counter = Counter()
    for number, task in enumerate(TASKS, 1):
        with initialize_config_module("gvla2.conf", version_base="1.3"):
            composed = compose(
                "run", overrides=[f"task={task}", "robot=sapien_panda", "memory=none", *overrides]
            )
        config = OmegaConf.to_object(composed)
        parts = build_components(config, registry)
        with closing(parts.robot), closing(parts.memory):
            record = seen(parts)
            other = None if parts.fallback is None else NamedPlanner("fallback", parts.fallback)
            first = NamedPlanner("planner", parts.planner)
            consultation = PlannerWithFallback(first, other, 0.0, parts.robot.arm, parts.skills)
            for row in rows:
                if row["scene"] == number:
                    found, detail = outcome(record, row, consultation)
                    counted[found] += 1
                    print(f"{found:17} {task:14} {row['sentence']}  {detail}", flush=True)
    total = sum(counted.values())
    good = counted["right"] + counted["rightly declined"]
    print(f"{name} {' '.join(overrides)}: {dict(counted)}; right or rightly declined {good}/{total}", end="")
    print(f" ({good / total:.0%}), wrong {counted['wrong']}/{total} ({counted['wrong'] / total:.1%})")


if __name__ == "__main__":
    main()
