"""Building components by name, with what they need."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from gvla2 import Component, ComponentConfig
from gvla2.errors import ConfigurationError, Gvla2Error, PluginError, UnknownComponentError
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.registry import Offer, Registry


@dataclasses.dataclass
class Nested:
    gain: float = 2.0


@dataclasses.dataclass
class Options(ComponentConfig):
    depth: int = 3
    inner: Nested = dataclasses.field(default_factory=Nested)


@dataclasses.dataclass
class Demanding(ComponentConfig):
    depth: int = 3

    def __post_init__(self) -> None:
        if self.depth < 0:
            raise ConfigurationError("depth must not be negative")


class Stand:
    """Has every method of every kind."""

    model = "stand"
    arm = instructions = None
    closed = 0

    def __init__(self, config: ComponentConfig, **needs: object) -> None:
        self.config, self.needs = config, needs

    def close(self) -> None:
        type(self).closed += 1

    def any(self, *_: object) -> None: ...

    plan = embed = rank = verify = recall = learn = predict = any


def a_registry(**components: Component[Any]) -> Registry:
    return Registry({kind: {c.name: Offer(c, Plugin("p"))} for kind, c in components.items()}, [Plugin("p")])


def test_needs_are_built_first_and_shared():
    made: list[str] = []

    def maker(name: str) -> Callable[..., Stand]:
        def build(config: ComponentConfig, **needs: object) -> Stand:
            made.append(name)
            return Stand(config, **needs)

        return build

    registry = a_registry(
        memory=Component("m", Options, maker("memory"), needs=("retriever", "embedder")),
        retriever=Component("r", Options, maker("retriever"), needs=("embedder",)),
        embedder=Component("e", Options, maker("embedder")),
    )
    root = {"memory": "m", "retriever": "r", "embedder": "e"}
    memory = registry.build(root, "memory")
    assert made == ["embedder", "retriever", "memory"]
    assert memory.needs["embedder"] is memory.needs["retriever"].needs["embedder"]
    both = registry.build_all(root, ["embedder", "memory"])
    assert both["embedder"] is both["memory"].needs["embedder"]


def test_a_circle_of_needs_is_reported():
    registry = a_registry(
        memory=Component("m", Options, Stand, needs=("retriever",)),
        retriever=Component("r", Options, Stand, needs=("memory",)),
    )
    with pytest.raises(ConfigurationError, match="circle: memory -> retriever -> memory"):
        registry.build({"memory": "m", "retriever": "r"}, "memory")


@pytest.mark.parametrize(
    ("component", "root", "error", "message"),
    [
        (
            Component("a", Options, lambda c: object()),
            "a",
            PluginError,
            r"built a object, which lacks plan\(\)",
        ),
        (
            Component("a", Options, lambda c: 1 / 0),
            "a",
            PluginError,
            "of plugin 'p' could not be built: ZeroDiv",
        ),
        (Component("a", Options, Stand), "b", UnknownComponentError, "No planner named 'b'"),
        (Component("a", Options, Stand), None, ConfigurationError, "chooses no planner"),
        (Component("a", Options, Stand), {"name": "a", "dept": 1}, ConfigurationError, "'dept'"),
        (
            Component("a", Options, Stand),
            Demanding(name="a"),
            ConfigurationError,
            "takes a Options, not a Demanding",
        ),
        (
            Component("a", Demanding, Stand),
            {"name": "a", "depth": -1},
            ConfigurationError,
            "must not be negative",
        ),
        (Component("a", Options, Stand, needs=("prior",)), "a", ConfigurationError, "chooses no prior"),
    ],
)
def test_building_fails_in_words(
    component: Component[Any], root: object, error: type[Exception], message: str
):
    with pytest.raises(error, match=message):
        a_registry(planner=component).build({"planner": root}, "planner")


def test_after_a_failure_what_was_built_is_closed():
    def fail(config: ComponentConfig) -> None:
        raise Gvla2Error("no")

    registry = a_registry(memory=Component("m", Options, Stand), planner=Component("p", Options, fail))
    before = Stand.closed
    with pytest.raises(Gvla2Error, match="no"):
        registry.build_all({"memory": "m", "planner": "p"}, ["memory", "planner"])
    assert Stand.closed == before + 1
