"""From an episode to memory's query and reports: task, lessons, transcript, and one story for each attempt and part.

No language model; deterministic.
Lessons are worded so that the next episode of the same kind gives the same words: numbers are in the typed effects,
where a merge can pool them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.metadata import version

from gvla2.episode.attempts import with_whole_program
from gvla2.episode.failure_diagnosis import approach_of, diagnose, theme_of
from gvla2.episode.record import EpisodeRecord
from gvla2.memory.contracts import Lesson, MemoryContext, MemoryEpisode, MemoryTask, Verdict
from gvla2.planning.calls import written
from gvla2.planning.contracts import Plan
from gvla2.planning.effects import ON, Prior, as_shares, look_of, sides_of
from gvla2.planning.programs import calls_program, kind_of, relative_steps, waypoints_program
from gvla2.planning.scene import SceneObject
from gvla2.planning.scene_brief import unique_names
from gvla2.planning.skill import Skill
from gvla2.skills.table import STANDARD

TRANSCRIPT_LIMIT = 8000
MAX_PARAMETERS = 3
"""Maximum number of a skill's key parameters in lessons: as many as a recall shows hints at a time.

Lift height and push distance are not among them: the instruction gives those. How far to swing, turn or pull something
open is: no sentence says it.
"""


def memory_task(record: EpisodeRecord) -> MemoryTask:
    """Memory's query: the instruction, what could be handled, and, once there is a plan, its skill."""
    skill = record.plan.skill if record.plan is not None else ""
    objects = record.scene.objects if record.scene is not None else ()
    return MemoryTask(record.instruction, skill, tuple(map(kind_of, objects)))


def memory_episode(
    record: EpisodeRecord, verdict: Verdict, skills: Mapping[str, Skill] = STANDARD
) -> MemoryEpisode:
    """Memory's report: the episode's lessons given its verdict, and their source."""
    return MemoryEpisode(
        task=memory_task(record),
        lessons=tuple(_lessons(record, verdict, skills)),
        transcript=transcript(record),
        recalled=record.recalled or MemoryContext(),
        source=record.episode_id,
        provenance={**record.choices, "gvla2": version("gvla2")},
    )


def handled_lengths(record: EpisodeRecord) -> dict[str, float]:
    """The sides of the handled object, metres by name: as the planner took them, else as perceived."""
    theme = theme_of(record)
    perceived = sides_of(theme) if theme is not None else {}
    return {**perceived, **dict(record.plan.scales.values() if record.plan is not None else ())}


def transcript(record: EpisodeRecord) -> str:
    """The episode in words: what was seen, planned, checked and executed; at most 8000 characters."""
    lines = [f"Instruction: {record.instruction}"]
    if record.scene is not None:
        lines += ["Seen:", *(f"- {_describe_object(obj)}" for obj in record.scene.objects)]
    if record.recalled is not None and record.recalled.items:
        lines.append(f"Recalled: {', '.join(item.id for item in record.recalled.items)}")
    if record.plan is not None:
        lines += _describe_plan(record.plan)
    if record.checks is not None:
        lines.append(
            "Checks: passed" if record.checks.passed else f"Checks: {' '.join(record.checks.reasons)}"
        )
    if record.report is not None:
        lines.append("Executed:")
        for done in record.report.waypoints:
            felt = f", contact of {', '.join(done.contacts)}" if done.contacts else ""
            held = {True: ", holding", False: ", empty", None: ""}[done.held]
            stop = f", STOPPED ({done.abort}): {done.message}" if done.abort else ""
            lines.append(
                f"- {done.index} {done.stage}: {1e3 * done.error:.0f} mm off, fingers "
                f"{1e3 * done.gripper_width:.0f} mm apart{held}{felt}{stop}"
            )
    if record.after_scene is not None:
        lines += ["Seen at the end:", *(f"- {_describe_object(obj)}" for obj in record.after_scene.objects)]
    if record.failure is not None:
        lines.append(f"Ended at {record.failure.stage}: {record.failure.message}")
    text = "\n".join(lines)
    return text if len(text) <= TRANSCRIPT_LIMIT else text[: TRANSCRIPT_LIMIT - 1] + "…"


def _lessons(record: EpisodeRecord, verdict: Verdict, skills: Mapping[str, Skill]) -> list[Lesson]:
    if verdict.outcome == "verified_success":
        return _from_success(record, skills)
    return _from_failure(record, skills, certain=verdict.outcome == "verified_fail")


def _from_success(record: EpisodeRecord, skills: Mapping[str, Skill]) -> list[Lesson]:
    """One hint per key parameter, with its value as a prior; the order of stages if there is none.

    Values that go with the object's size are shares of it, so that they hold for other sizes.
    """
    plan, subject, look = record.executable.plan, _subject(record, skills), _look(record)
    usable = [n for n, v in plan.parameters.items() if math.isfinite(v)]
    ranked = (skills[plan.skill].key if plan.skill in skills else ()) or sorted(usable)
    chosen = [n for n in ranked if n in usable][:MAX_PARAMETERS]
    if not chosen:
        stages = list(dict.fromkeys(w.stage for w in record.executable.trajectory))
        hint = Lesson("procedural_hint", f"{subject}: these stages succeeded: {', '.join(stages)}.")
        return [hint, *_programs(record, subject)]
    hints = [
        Lesson(
            "procedural_hint",
            f"{subject}: this {name.replace('_', ' ')} succeeded.",
            as_shares(
                Prior(name, float(plan.parameters[name]), count=1, skill=plan.skill, object=look), plan.scales
            ).to_json(),
        )
        for name in chosen
    ]
    return [*hints, *_programs(record, subject)]


def _programs(record: EpisodeRecord, subject: str) -> list[Lesson]:
    """The successful program: as the planner wrote it, and in the other languages as it was carried out."""
    plan, scene = record.planned.plan, record.planned.scene
    names = unique_names(scene)
    whole = not plan.remaining and not record.partial
    about = {"roles": plan.roles, "skill": plan.skill, "instruction": record.instruction}
    found = {plan.program.language: plan.program} if plan.program is not None else {}
    lines = [written(call, names) for call in plan.calls]
    if "calls" not in found and whole and lines and all(lines):
        ids = {name: i for i, name in names.items()}
        found["calls"] = calls_program(lines, ids, scene, **about)
    if "waypoints" not in found and whole and plan.trajectory is not None:
        steps = relative_steps(plan.trajectory, scene, plan.roles)
        if steps:
            found["waypoints"] = waypoints_program(steps, scene, **about)
    words = {"calls": "this program of calls succeeded", "waypoints": "these waypoints of the hand succeeded"}
    return [
        Lesson("procedural_hint", f"{subject}: {words[language]}.", program.to_json())
        for language, program in found.items()
    ]


def _from_failure(record: EpisodeRecord, skills: Mapping[str, Skill], *, certain: bool) -> list[Lesson]:
    """Diagnosed causes to avoid; or, for a certain failure without any, that it failed and how it ended."""
    subject = _subject(record, skills)
    lessons = [
        Lesson(
            "failure_avoidance",
            f"{subject}: failed because {signal.words}.",
            signal.effect.to_json() if signal.effect else None,
        )
        for signal in diagnose(record, skills)
    ]
    if lessons or not certain:
        return lessons
    stopped = record.report.abort if record.report is not None else None
    how = (
        f"and it stopped at '{stopped.stage}' ({stopped.abort})" if stopped else "although it ran to its end"
    )
    words = f"{subject}: the goal was not reached {how}; do not expect the same motion to work."
    return [Lesson("failure_avoidance", words)]


def _subject(record: EpisodeRecord, skills: Mapping[str, Skill]) -> str:
    """Skill, size class, look and shape, and approach: the kind of episode, without its numbers.

    It includes the look: objects that look alike behave alike, others may not.
    """
    plan, theme = record.planned.plan, theme_of(record)
    known = skills[plan.skill].words if plan.skill in skills else ""
    words = known or plan.skill.capitalize() or "Follow an instruction"
    if theme is None:
        return words
    shape = "object" if theme.shape == "other" else theme.shape
    approach = approach_of(plan)
    described = " ".join(part for part in (_size_class(theme), _look(record).split(ON)[0], shape) if part)
    whole = _look(record).partition(ON)[2]
    described += f" of the {whole} object" if whole else ""
    return f"{words} a {described}" + (f" from the {approach}" if approach else "")


def _look(record: EpisodeRecord) -> str:
    """The handled object's colours."""
    return look_of(theme_of(record), record.scene) if record.scene is not None else ""


def _size_class(obj: SceneObject) -> str:
    """In words: "small", "tall medium", "flat tiny"; boxes of the same words have similar shapes."""
    across, height = float(max(obj.extents[:2])), float(obj.extents[2])
    build = "tall " if height > 1.5 * across else "flat " if height < 0.5 * across else ""
    sizes = (("tiny", 0.03), ("small", 0.075), ("medium", 0.15))
    return build + next((name for name, limit in sizes if max(across, height) < limit), "large")


def _describe_object(obj: SceneObject) -> str:
    place = ", ".join(f"{v:.3f}" for v in obj.centre)
    size = " x ".join(f"{v:.3f}" for v in obj.extents)
    return f"{obj.id}: {obj.label} ({obj.shape}, {size} m) at ({place})"


def _describe_plan(plan: Plan) -> list[str]:
    if plan.abstention is not None:
        return [f"Planner declined ({plan.abstention.kind}): {plan.abstention.message}"]
    roles = ", ".join(f"{role} {name}" for role, name in sorted(plan.roles.items()))
    numbers = ", ".join(f"{name} {value:.4g}" for name, value in sorted(plan.parameters.items()))
    stages = ", ".join(w.stage for w in plan.trajectory) if plan.trajectory else "none"
    return [f"Plan: {plan.skill} ({roles}); {numbers or 'no parameters'}; stages: {stages}"]


def stories_of(
    record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD
) -> Iterator[tuple[MemoryEpisode, Verdict]]:
    """The stories of a finished episode, first to last, without those that nobody judged or in which nothing moved.

    The last part of the last attempt has the episode's id, others that id and a number: ``#2`` the second attempt,
    ``#2.1`` its first part.
    """
    attempts = (*record.attempts, replace(record, attempts=()))
    for number, attempt in enumerate(attempts, 1):
        parts = with_whole_program(attempt.whole)
        for place, part in enumerate(parts, 1):
            if part.plan is None or part.verdict is None or part.report is None or not part.report.waypoints:
                continue
            name = f"#{number}.{place}" if len(parts) > 1 else f"#{number}"
            last = number == len(attempts) and place == len(parts)
            source = record.episode_id if last else f"{record.episode_id}{name}"
            story = memory_episode(replace(part, episode_id=source), part.verdict, skills)
            lines, plan = [story.transcript], part.plan
            if len(parts) > 1 or plan.remaining:
                left = f" Still to come: {', '.join(map(str, plan.remaining))}." if plan.remaining else ""
                lines.insert(0, f"Part {place} of a program: {', '.join(map(str, plan.calls))}.{left}")
            if plan.fallback:
                lines.append(f"Planned by the fallback planner '{plan.fallback}'.")
            yield replace(story, transcript="\n".join(lines)), part.verdict
