"""The loop, with the real simulator, perceiver, planner, memory and verifier; faults are injected by wrappers."""

import json
import sys
import types
from dataclasses import replace

import numpy as np
import pytest

from gvla2.commands.hydra_job import explain
from gvla2.commands.run import run_episodes
from gvla2.episode.loop import EpisodeRequest, SilentListener, run_episode
from gvla2.memory.contracts import Learned, MemoryContext, MemoryItem
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.effects import Bound
from gvla2.robot.task import Body, Joint
from tests.quick import QUICK

ORDER = (
    "setup", "observe", "perceive", "reconstruct", "recall", "plan", "check", "execute", "verify", "learn",
    "success_check",
)  # fmt: skip


# By its own eyes, where what is seen matters.
SEEN = (
    "perceiver=classical",
    "robot.image_size=160",
    "robot.video_fps=5",
    "robot.cameras=[front,left_shoulder,right_shoulder,wrist]",
)


class Listener(SilentListener):
    def __init__(self):
        self.records, self.frames = {}, 0

    def stage(self, record, stage):
        self.records[stage] = record

    def frame(self, image):
        self.frames += 1


class Wrapped:
    """Another object with some of its methods replaced."""

    def __init__(self, inner, **methods):
        self._inner, self._methods = inner, methods

    def __getattr__(self, name):
        return self._methods.get(name) or getattr(self._inner, name)


def test_an_episode_goes_through_every_stage_and_learns(parts_of):
    parts, listener = parts_of(*QUICK, *SEEN), Listener()
    record = run_episode(parts, EpisodeRequest(seed=1), listener)
    assert tuple(listener.records) == ORDER
    assert record.failure is None, record.failure
    assert record.success_check is not None
    assert record.success_check.relaxed
    assert record.verdict.outcome == "verified_success"
    assert record.learned.added
    assert listener.frames > 5
    assert listener.records["learn"].success_check is None, (
        "success must be checked after everything is learned"
    )
    # What was learned is recalled next time, and shapes the plan's parameters as typed effects.
    again = run_episode(parts, EpisodeRequest(seed=3))
    assert {item.id for item in again.recalled.items} & set(record.learned.added)


class Renamed:
    """A task whose bodies, joints and sentences' origin carry no telling names."""

    def __init__(self, inner):
        self._inner = inner

    instructions = ("anything",)

    def sample(self, rng, site, instruction=None):
        instance = self._inner.sample(rng, site, instruction)
        names = {body.name: f"x{i}" for i, body in enumerate(instance.layout.bodies)}
        joints = {joint.name: f"y{i}" for i, joint in enumerate(instance.layout.joints)}
        bodies = tuple(_renamed_body(b, names) for b in instance.layout.bodies)
        moved = tuple(_renamed_joint(j, names, joints) for j in instance.layout.joints)
        back = _Renaming(names, joints)
        succeeded = {p: (lambda world, f=f: f(back.of(world))) for p, f in instance.succeeded.items()}
        glows = tuple(replace(g, body=names[g.body], joint=joints[g.joint]) for g in instance.layout.glows)
        layout = replace(instance.layout, bodies=bodies, joints=moved, glows=glows)
        return replace(instance, layout=layout, succeeded=succeeded, goal="")


def _renamed_body(body: Body, names) -> Body:
    return replace(body, name=names[body.name])


def _renamed_joint(joint: Joint, names, joints) -> Joint:
    return replace(joint, name=joints[joint.name], parent=names[joint.parent], child=names[joint.child])


class _Renaming:
    def __init__(self, names, joints):
        self.names, self.joints = names, joints

    def of(self, world):
        return Wrapped(
            world,
            pose=lambda body: world.pose(self.names[body]),
            held=lambda body: world.held(self.names[body]),
            joint=lambda name: world.joint(self.joints[name]),
            peak=lambda name: world.peak(self.joints[name]),
        )


@pytest.mark.parametrize("task", ["pick_and_lift", "lamp_on"])
def test_names_of_bodies_and_tasks_change_nothing(parts_of, task):
    parts = parts_of(*QUICK, *SEEN, f"task={task}", "memory=none")
    plain = run_episode(parts, EpisodeRequest(seed=3))
    blind = replace(parts, task=Renamed(parts.task), choices={**parts.choices, "task": "anything"})
    renamed = run_episode(blind, EpisodeRequest(seed=3))
    assert plain.plan.trajectory is not None, plain.failure
    assert renamed.plan.trajectory.to_json() == plain.plan.trajectory.to_json()
    assert renamed.success_check == plain.success_check
    np.testing.assert_array_equal(renamed.report.joint_path, plain.report.joint_path)


@pytest.mark.parametrize(
    "sentence", ["juggle the walrus", "pick up the zeppelin", "", "\x00;DROP TABLE memory;--"]
)
def test_an_instruction_that_names_nothing_abstains(parts_of, sentence):
    record = run_episode(parts_of(*QUICK), EpisodeRequest(seed=1, instruction=sentence))
    assert record.failure is not None
    assert record.failure.stage == "plan"
    assert record.report is None
    assert record.success_check is not None
    assert not record.success_check.relaxed
    assert record.learned is None or record.learned == Learned()


def test_an_effect_that_says_nothing_definite_is_passed_over_with_a_note(parts_of):
    parts = parts_of(*QUICK)
    effects = ({"kind": "bound", "parameter": "lift_height"}, Bound("lift_height", 0.3).to_json())
    item, sound = (
        MemoryItem(name, "failure_avoidance", "Lift higher.", 0.9, 0.9, {}, True, effect=effect)
        for name, effect in zip(("r1", "r2"), effects, strict=True)
    )
    recall = Wrapped(parts.memory, recall=lambda task: MemoryContext((item, sound), "Lift higher."))
    record = run_episode(replace(parts, memory=recall), EpisodeRequest(seed=0))
    assert record.verdict.outcome == "verified_success"
    assert any("'r1' was ignored" in note for note in record.notes)
    assert record.plan.parameters["lift_height"] >= 0.3


def lost(self, request):
    return {}["nowhere"]


def leave(self, request):
    raise SystemExit(7)


@pytest.mark.parametrize(
    ("crash", "error", "shown"),
    [
        (lost, KeyError, "KeyError: 'nowhere'"),
        (leave, RuntimeError, "RuntimeError: SystemExit(7) would have ended the process"),
    ],
)
def test_a_crash_is_recorded_with_its_stage(
    registry, compose_run, tmp_path, monkeypatch, crash, error, shown
):
    from gvla2_plugins.skill.planner import SkillPlanner

    crash_in_its_module = types.FunctionType(crash.__code__, vars(sys.modules[SkillPlanner.__module__]))
    monkeypatch.setattr(SkillPlanner, "plan", crash_in_its_module)
    with pytest.raises(error) as caught:
        run_episodes(compose_run(*QUICK), registry, tmp_path / "out")
    assert explain(caught.value) == shown
    failure = json.loads((tmp_path / "out" / "result.json").read_text())["failure"]
    assert (failure["stage"], failure["message"]) == ("plan", shown)


def test_an_interrupt_in_mid_motion_is_recorded_and_nothing_is_learned(parts_of):
    class Impatient(Listener):
        moments = 0

        def moment(self, moment):  # frames are drawn beside the motion, and may come after it
            self.moments += 1
            if self.moments == 3:
                raise KeyboardInterrupt

    parts, listener = parts_of(*QUICK), Impatient()
    with pytest.raises(KeyboardInterrupt):
        run_episode(parts, EpisodeRequest(seed=1), listener)
    assert listener.records["execute"].failure.kind == "interrupted"
    assert listener.records["execute"].report.abort.abort == "interrupted"
    assert "learn" not in listener.records
    # The same robot and memory serve the next episode, which remembers nothing of the broken one.
    record = run_episode(parts, EpisodeRequest(seed=1))
    assert not record.recalled.items
    assert record.failure is None


def crash(*_):
    raise RuntimeError("a mistake of its own")


def test_nobody_writes_into_what_others_see(parts_of):
    parts, seen = parts_of(*QUICK, "memory=none"), []

    def plan(request):
        seen.append(request)
        return Plan(None, abstention=Abstention("other", "Only looking."))

    run_episode(replace(parts, planner=Wrapped(parts.planner, plan=plan)), EpisodeRequest(seed=1))
    (request,) = seen
    obj, view = request.scene.objects[0], request.observation.views[0]
    arrays = (obj.world_from_object, obj.extents, obj.points, view.image, view.depth, request.joints)
    assert not any(array.flags.writeable for array in (*arrays, request.start, request.scene.workspace.low))


@pytest.mark.parametrize(
    ("verify", "shown"),
    [
        (crash, "The verifier 'geometric' of plugin 'geometric' crashed: RuntimeError: a mistake of its own"),
        (
            lambda evidence: None,
            "The verifier 'geometric' of plugin 'geometric' returned NoneType, not a Verdict.",
        ),
    ],
    ids=["crash", "none"],
)
def test_a_broken_verifier_was_unavailable_and_the_episode_goes_on(parts_of, verify, shown):
    parts, listener = parts_of(*QUICK, "memory.admission=true"), Listener()
    broken = replace(parts, verifier=Wrapped(parts.verifier, verify=verify))
    record = run_episode(broken, EpisodeRequest(seed=1), listener)
    assert tuple(listener.records) == ORDER
    assert record.verdict.outcome == "unavailable"
    assert shown in record.verdict.reasons[0]
    assert record.failure is None
    assert record.success_check.relaxed
    assert not record.learned.added, "what nobody judged is no knowledge"


@pytest.mark.parametrize(
    ("method", "shown"),
    [(crash, "crashed: RuntimeError: a mistake"), (lambda *_: None, "returned NoneType, not a ")],
    ids=["crash", "none"],
)
def test_a_broken_memory_is_said_and_the_episode_goes_on(parts_of, method, shown):
    parts = parts_of(*QUICK)
    broken = replace(parts, memory=Wrapped(parts.memory, recall=method, learn=method))
    record = run_episode(broken, EpisodeRequest(seed=1))
    assert record.success_check.relaxed
    for note, what in zip(record.notes, ("Memory was not used: ", "Nothing was learned: "), strict=True):
        assert note.startswith(f"{what}The memory 'governed' of plugin 'governed' {shown}")
