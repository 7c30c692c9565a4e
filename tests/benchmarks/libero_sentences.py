"""Sentences of LIBERO's suites in their own scenes: which ones become the calls that the suite's goal asks for.

    python tests/benchmarks/libero_sentences.py libero_spatial libero_goal_task

The planner ``skill`` reads each sentence in the true scene of initial state 0; nothing moves. A sentence is right if
each predicate of the goal is reached by one of its calls, or holds already, and no other object is moved. Some goals of
LIBERO contradict their sentence (libero_90/17, libero_10_task/8): those count as wrong all the same.
"""

import re
import sys
from collections import Counter
from dataclasses import replace

import numpy as np

from gvla2.planning.contracts import Abstention
from gvla2.planning.part_hierarchy import is_ajar, knob_of
from gvla2_plugins.libero import LiberoConfig
from gvla2_plugins.libero.worlds import LiberoWorld, bddl_files
from gvla2_plugins.skill.planner import read

SIDES = {"left": "left_of", "right": "right_of", "front": "front_of", "back": "behind"}
WHOLE = ("contain_region", "cook_region", "top_side", "heating_region")
"""Regions that are an object's own, not one of its parts'."""


def merged(calls):
    """The calls without picks that a placement of the same object follows."""
    return [
        call
        for call, after in zip(calls, (*calls[1:], None), strict=True)
        if not (call.skill == "pick" and after and after.theme == call.theme)
    ]


def located(name, scene):
    """The object that a name of a goal belongs to, and the rest of the name, a region of it."""
    for obj in sorted(scene.objects, key=lambda o: -len(o.id)):
        own = obj.id.removesuffix("_main")
        if not obj.parent and (name == own or name.startswith(f"{own}_")):
            return obj, name.removeprefix(own).lstrip("_")
    return None, name


def parts(obj, region, scene):
    """The ids of what a region means: a part of its name, else the object and all its parts."""
    named = {p.id for p in scene.parts_of(obj.id) if region and region.split("_")[0] in p.label.split()}
    return named or scene.family(obj.id)


def put(call, theme, where, scene, world):
    """Whether a call puts the object where a goal has it."""
    obj, _ = located(theme, scene)
    if call.skill not in ("place", "push") or call.theme != obj.id or not call.goal:
        return False
    goal, (holder, region) = scene[call.goal], located(where, scene)
    if holder is None:  # a region of the table beside an object
        beside = re.search(r"_([a-z]+)_(left|right|front|back)_region$", where)
        return bool(beside) and goal.label.endswith(beside[1]) and call.relation == SIDES[beside[2]]
    if call.relation not in ("on", "in", "to"):
        return False
    if call.xy is not None:
        site = world.model.site(where).id
        off = np.abs(np.array(call.xy) - world.data.site_xpos[site][:2])
        return goal is holder and bool((off < world.model.site_size[site][:2]).all())
    inside = parts(holder, region, scene)
    whole = not region or region in WHOLE or inside == scene.family(holder.id)
    return call.goal == holder.id if whole else call.goal in inside


def reached(predicate, call, scene, world):
    kind, name, *where = predicate
    if kind in ("on", "in"):
        return put(call, name, where[0], scene, world)
    obj, region = located(name, scene)
    if kind in ("open", "close"):
        return call.skill in (kind, "pull" if kind == "open" else kind) and call.theme in parts(
            obj, region, scene
        )
    knob = knob_of(obj, scene)
    end = knob.joint.position + call.theta.get("turn", 0.0)
    return call.skill == "twist" and call.theme == knob.id and (end > 0.5) == (kind == "turnon")


def so_already(predicate, scene):
    kind, name, *_ = predicate
    obj, region = located(name, scene)
    if kind in ("open", "close"):
        return any(is_ajar(scene[i]) == (kind == "open") for i in parts(obj, region, scene))
    return kind.startswith("turn") and (knob_of(obj, scene).joint.position > 0.5) == (kind == "turnon")


def outcome(world):
    scene = replace(world.true_scene(), viewpoint=LiberoConfig().viewpoint)
    found = read(world.instruction, scene)
    if isinstance(found, Abstention):
        return "declined", found.message
    calls, goal = merged(found), world.env.parsed_problem["goal_state"]
    met = [so_already(p, scene) or any(reached(p, c, scene, world) for c in calls) for p in goal]
    moved = [c for c in calls if c.skill in ("place", "push", "pick")]
    asked = all(any(reached(p, call, scene, world) for p in goal) for call in moved)
    return ("right" if all(met) and asked else "wrong"), "; ".join(map(str, found))


def main() -> None:
    counted: dict[str, Counter] = {}
    for task, file in bddl_files().items():
        suite = task.split("/")[0]
        if suite in sys.argv[1:]:
            world = LiberoWorld(task, file, LiberoConfig())
            world.begin(0)
            result, detail = outcome(world)
            counted.setdefault(suite, Counter())[result] += 1
            if result != "right":
                print(f"{result:9} {task:22} {world.instruction}  [{detail[:120]}]", flush=True)
            world.close()
    for suite, counts in counted.items():
        print(suite, ", ".join(f"{n} {result}" for result, n in counts.items()))


if __name__ == "__main__":
    main()
