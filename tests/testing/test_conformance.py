"""The conformance checks pass what is good, the reference plugins among it, and catch what is bad."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from gvla2 import Component, ComponentConfig
from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import Learned, MemoryContext, MemoryItem, Ranked, Verdict
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.reconstruction.contracts import GeometryEstimate, Reconstruction
from gvla2.testing import CHECKS, ConformanceError, check_component
from gvla2.testing.inputs import RED, TABLE, ball, scene, views

OWN = {
    ("prior", "file"): "prior.path=",
    ("prior", "vggt"): "pip install",
    ("reconstructor", "fast_sam3d"): "reconstructor.checkout=",
    ("reconstructor", "mv_sam3d"): "reconstructor.checkout=",
    ("reconstructor", "sam3d"): "reconstructor.checkout=",
    ("reconstructor", "result_tree"): "reconstructor.root=",
    ("camera", "realsense"): "camera.calibration=",
    ("camera", "replay"): "camera.path=",
    ("language", "llama_cpp"): "language.model=",
    ("perceiver", "oracle"): "needs a simulated robot",
    ("perceiver", "sam"): "perceiver.weights=",
    ("perceiver", "sam3"): "perceiver.weights=",
    ("perceiver", "detector"): "perceiver.weights=",
    ("robot", "sapien_arm"): "robot.urdf=",
    ("task", "tabletop_objects"): "task.objects.root=",
}
"""Components that need something of the user's own, and what their error says to do. Their own tests give it them."""

PLUGINS = load_plugins()
REFERENCE = [
    (kind, name)
    for kind in CHECKS
    for name in PLUGINS.components(kind)
    # Their own tests know whether there is a GPU, give the arm its bus, keep trackers off the network, give an
    # agent a model that answers, and refine few Gaussians.
    if (kind, name) not in OWN
    and name not in ("gsplat", "piper", "mlflow", "wandb", "rerun", "mini_swe", "splat")
]


@pytest.mark.parametrize(("kind", "name"), OWN)
def test_what_needs_something_of_ones_own_says_so(kind: str, name: str, registry: Registry):
    def use() -> None:
        made = registry.get(kind, name).build(registry.get(kind, name).config(name=name))
        if kind == "reconstructor":  # these look for what they need when they are used
            made.reconstruct(views())

    with pytest.raises(Gvla2Error, match=re.escape(OWN[kind, name])):
        use()


@pytest.mark.parametrize(("kind", "name"), REFERENCE)
def test_reference_components_conform(kind: str, name: str, registry: Registry, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    component = registry.get(kind, name)
    chosen = {need: min(registry.components(need)) for need in component.needs}
    nobody = {"name": "endpoint", "retries": 0}
    needs = registry.build_all({**chosen, "language": nobody}, component.needs)
    check_component(component, kind, **needs)


class Bad:
    """Any component: its methods are given as functions of their arguments."""

    def __init__(self, **methods: Any) -> None:
        vars(self).update(methods)


def lifting(*points: tuple[float, float, float], **changes: Any) -> Plan:
    return Plan(Trajectory(tuple(Waypoint(p, 0.5, "go", **changes) for p in points)))


INSIDE = (0.3, 0.0, TABLE + 0.3)


def planner(answer: Callable[[Any], Any]) -> Bad:
    return Bad(plan=answer)


def touching_input(request: Any) -> Plan:
    request.scene.objects[0].points[0] = 0.0
    return lifting(INSIDE, INSIDE)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda r: None, "NoneType, not a Plan"),
        (lambda r: Plan(None), "neither a trajectory nor an abstention"),
        (
            lambda r: replace(lifting(INSIDE, INSIDE), abstention=Abstention("other", "no")),
            "either a trajectory or",
        ),
        (lambda r: Plan(None, abstention=Abstention("", "no")), "abstention of kind ''"),
        (lambda r: Plan(None, abstention=Abstention("other", "")), "needs a message"),
        (lambda r: lifting(INSIDE), "2 to 20 waypoints, got 1"),
        (lambda r: lifting(*[INSIDE] * 21), "got 21"),
        (lambda r: lifting(INSIDE, (0.3, float("nan"), 1.0)), "not a tuple of three finite numbers"),
        (
            lambda r: Plan(Trajectory((Waypoint(INSIDE, 1.5, "a"), Waypoint(INSIDE, 0, "b")))),
            r"lie in \[0, 1\]",
        ),
        (lambda r: lifting(INSIDE, INSIDE, frame="base"), "frame is 'base'"),
        (lambda r: lifting(INSIDE, INSIDE, speed=0.0), "must be positive"),
        (lambda r: lifting(INSIDE, INSIDE, carries="ghost"), "ghost"),
        (lambda r: replace(lifting(INSIDE, INSIDE), roles={"theme": "ghost"}), "role 'theme' names 'ghost'"),
        (
            lambda r: replace(lifting(INSIDE, INSIDE), parameters={"lift": float("inf")}),
            "'lift': inf}, which is not a mapping from names to finite",
        ),
        (lambda r: 1 / 0, "raised ZeroDivisionError"),
        (lambda r: lifting(INSIDE, INSIDE) if r.scene.objects else r.scene["red_cube"], "for an empty scene"),
        (touching_input, "read-only"),
    ],
)
def test_bad_planners_are_caught(answer: Callable[[Any], Any], message: str):
    with pytest.raises(ConformanceError, match=message):
        CHECKS["planner"](planner(answer))


def seeing(change: Callable[[Scene], Any]) -> Bad:
    return Bad(perceive=lambda observation, instruction, workspace: change(scene()))


def test_a_good_perceiver_passes():
    CHECKS["perceiver"](seeing(lambda s: s))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: None, "must be Scene"),
        (lambda s: replace(s, objects=s.objects[:1]), "No object lies within 3 cm of the blue cube"),
        (lambda s: replace(s, objects=s.objects * 2), "must be unique"),
        (lambda s: replace(s, table_height=TABLE + 0.05), "height is off by 0.050"),
        (
            lambda s: s.with_object(replace(s["red_cube"], extents=np.array([0.1, -0.1, 0.1]))),
            "not be negative",
        ),
        (
            lambda s: s.with_object(replace(s["red_cube"], points=np.zeros((3, 2)))),
            "points must have the shape",
        ),
        (
            lambda s: s.with_object(replace(s["red_cube"], world_from_object=np.diag([1, 1, -1, 1.0]))),
            "mirrored",
        ),
        (lambda s: s.with_object(replace(s["red_cube"], parent="lamp")), "'lamp' is not in the scene"),
        (lambda s: s["nothing"], "raised KeyError"),
    ],
)
def test_bad_perceivers_are_caught(change: Callable[[Scene], Any], message: str):
    with pytest.raises(ConformanceError, match=message):
        CHECKS["perceiver"](seeing(change))


def estimate(v: Any, **changes: Any) -> GeometryEstimate:
    shape = (len(v), v[0].camera.height, v[0].camera.width)
    whole = GeometryEstimate(np.ones(shape, dtype=np.float32), np.ones(shape, dtype=np.float32))
    return replace(whole, **changes)


@pytest.mark.parametrize(
    ("predict", "message"),
    [
        (lambda v: estimate(v, depth=np.ones((1, 2, 2), dtype=np.float32)), "must have the shape"),
        (lambda v: estimate(v, depth=-estimate(v).depth), "must be positive"),
        (lambda v: estimate(v, depth=estimate(v).depth / np.float32(1e-45)), "never infinite"),
        (lambda v: estimate(v, confidence=-estimate(v).depth), "number >= 0"),
        (lambda v: estimate(v, world_from_camera=np.zeros((len(v), 4, 4))), "not orthonormal"),
        (lambda v: estimate(v) if v[0].depth is not None else v[0].points(), "one colour view"),
        (lambda v: v[0].image.sort() if v[0].depth is not None else None, "read-only"),
    ],
)
@pytest.mark.filterwarnings("ignore:(overflow|divide by zero)")
def test_bad_priors_are_caught(predict: Callable[[Any], Any], message: str):
    CHECKS["prior"](Bad(predict=estimate))
    with pytest.raises(ConformanceError, match=message):
        CHECKS["prior"](Bad(predict=predict))


def test_bad_reconstructors_are_caught():
    centre = RED.world_from_block[:3, 3].astype(np.float32)
    there = ball(50, 0.02).with_centres(ball(50, 0.02).centres + centre)
    CHECKS["reconstructor"](Bad(reconstruct=lambda v: Reconstruction(there, None)))
    for made, message in (
        (Reconstruction(ball(50, 0.02), None), "in another frame"),
        (Reconstruction(None, None), "Gaussians or a mesh"),
        (Reconstruction(there, None, ""), "never empty"),
        ("a cube", "must be Reconstruction"),
    ):
        with pytest.raises(ConformanceError, match=message):
            CHECKS["reconstructor"](Bad(reconstruct=lambda v, made=made: made))


@pytest.mark.parametrize(
    ("fuse", "message"),
    [
        (lambda a, b, u, v: a[:-1], "must have the shape"),
        (lambda a, b, u, v: a + 0.001, "must fuse to themselves"),
        (lambda a, b, u, v: (a * u[:, None] + b * v[:, None]) / (u + v)[:, None], "not finite"),
        (lambda a, b, u, v: np.add(a, b, out=a), "read-only"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_bad_fusions_are_caught(fuse: Callable[..., Any], message: str):
    CHECKS["fusion"](Bad(fuse=lambda a, b, u, v: 0.5 * (a + b)))
    with pytest.raises(ConformanceError, match=message):
        CHECKS["fusion"](Bad(fuse=fuse))


@pytest.mark.parametrize(
    ("render", "message"),
    [
        (lambda g, c, b: (np.ones((c.height, c.width, 3)), np.ones((c.height, c.width))), "float32"),
        (lambda g, c, b: _flat(c, b, 0.0), "has alpha 0.00"),
        (lambda g, c, b: _flat(c, (0.9, 0.2, 0.1), 1.0), "must show the background"),
        (lambda g, c, b: _flat(c, b, 2.0), r"leaves \[0, 1\]"),
    ],
)
def test_bad_renderers_are_caught(render: Callable[..., Any], message: str):
    with pytest.raises(ConformanceError, match=message):
        CHECKS["renderer"](Bad(render=render))


def _flat(camera: Any, colour: Any, alpha: float) -> tuple[Any, Any]:
    size = (camera.height, camera.width)
    return np.broadcast_to(np.float32(colour), (*size, 3)), np.full(size, alpha, dtype=np.float32)


def remembering(context: Any = None, learned: Any = None, close: Any = None) -> Bad:
    return Bad(
        recall=lambda task: MemoryContext() if context is None else context,
        learn=lambda episode, verdict: Learned() if learned is None else learned,
        close=close or (lambda: None),
    )


ITEM = MemoryItem("r1", "procedural_hint", "lift", 0.9, 0.5, {"text": 0.5}, False)


@pytest.mark.parametrize(
    ("memory", "message"),
    [
        (remembering(context="nothing"), "must be MemoryContext"),
        (remembering(learned=3), "must be Learned"),
        (remembering(context=MemoryContext((ITEM, ITEM))), "recalled twice"),
        (remembering(context=MemoryContext((ITEM,), abstained="unsure")), "that abstains"),
        (remembering(context=MemoryContext((replace(ITEM, score=2.0),))), "terms sum to 0.5"),
        (remembering(context=MemoryContext((replace(ITEM, confidence=2.0),))), "confidence must lie"),
        (remembering(context=MemoryContext(text="x" * 200_000)), "must be bounded"),
        (remembering(close=iter([None]).__next__), "called twice"),
        (Bad(recall=lambda t: MemoryContext(), close=lambda: None), r"lacks learn\(\)"),
    ],
)
def test_bad_memories_are_caught(memory: Bad, message: str):
    CHECKS["memory"](remembering(MemoryContext((ITEM,), "lift")))
    with pytest.raises(ConformanceError, match=message):
        CHECKS["memory"](memory)


@pytest.mark.parametrize(
    ("rank", "message"),
    [
        (lambda t, c, q: ([Ranked(9, 1.0, {"a": 1.0})], ""), "no such row"),
        (lambda t, c, q: ([Ranked(i, i, {"a": i}) for i in range(len(c))], ""), "best first"),
        (lambda t, c, q: ([Ranked(0, 1.0, {"a": 1.0})] * min(2, len(c)), ""), "comes twice"),
        (lambda t, c, q: ([Ranked(0, 1.0, {"a": 1.0})][: len(c)], "unsure"), "returns no rows"),
        (lambda t, c, q: ([Ranked(0, 1.0, {"a": 0.2})][: len(c)], ""), "terms sum to 0.2"),
        (lambda t, c, q: ([], None), "must be str"),
        (
            lambda t, c, q: ([Ranked(int(np.argmax(c.cosine(q))), 1.0, {"a": 1.0})], ""),
            "raised ValueError",
        ),
    ],
)
def test_bad_retrievers_are_caught(rank: Callable[..., Any], message: str):
    with pytest.raises(ConformanceError, match=message):
        CHECKS["retriever"](Bad(rank=rank))


def _unit(texts: Any) -> Any:
    return np.array([[1.0, 0.0] if t else [0.0, 0.0] for t in texts], dtype=np.float32).reshape(-1, 2)


@pytest.mark.parametrize(
    ("embed", "message"),
    [
        (lambda texts: 2 * _unit(texts), "length 1"),
        (lambda texts: _unit(["x" for _ in texts]), "zero row"),
        (lambda texts: _unit(texts).astype(np.float64), "float32"),
        (lambda texts: _unit(texts)[:, :, None], "must have the shape"),
        (lambda texts: _unit(texts) if texts else np.zeros((0, 5)), "of no text"),
        (lambda texts: _unit(texts) * (1 if len(texts) > 1 else -1), "rest of the batch"),
    ],
)
def test_bad_embedders_are_caught(embed: Callable[..., Any], message: str):
    CHECKS["embedder"](Bad(model="two", embed=_unit))
    with pytest.raises(ConformanceError, match=message):
        CHECKS["embedder"](Bad(model="two", embed=embed))


@pytest.mark.parametrize(
    ("verify", "message"),
    [
        (
            lambda e: Verdict("verified_success", 0.2, 0.6, {"a": 0.2}),
            "is 'verified_fail', not 'verified_success'",
        ),
        (lambda e: Verdict("verified_success", 0.9, 0.1, {"a": 0.9}), "has the confidence 0.800"),
        (lambda e: Verdict("verified_success", 1.4, 1.8, {"a": 1.4}), "quality must lie"),
        (lambda e: Verdict("unavailable", 0.0, 0.0), "says why"),
        (lambda e: "yes", "must be Verdict"),
        (lambda e: Verdict.from_criteria({"done": float(e.report.completed)}), "raised AttributeError"),
        (
            lambda e: Verdict.from_criteria({"a": 0.1 if getattr(e, "gripper_width", 0) else 0.9}),
            "judged better",
        ),
    ],
)
def test_bad_verifiers_are_caught(verify: Callable[..., Any], message: str):
    with pytest.raises(ConformanceError, match=message):
        CHECKS["verifier"](Bad(verify=verify))


# -- components -------------------------------------------------------------------------------------------------


@dataclass
class Fine(ComponentConfig):
    depth: int = 3


def test_bad_components_are_caught():
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
