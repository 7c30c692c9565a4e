"""Assembling an episode's components from the registry, as a configuration chooses them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gvla2.component import described
from gvla2.errors import ConfigurationError
from gvla2.plugins.kinds import KINDS, NONE, OWN_TASK
from gvla2.plugins.registry import Registry
from gvla2.reconstruction.options import SOFT_HULL
from gvla2.robot.options import TaskConfig

if TYPE_CHECKING:
    from gvla2.episode.loop import Components
    from gvla2.reconstruction.options import BranchOptions

LOOP = ("robot", "task", "perceiver", "planner", "fallback", "policy", "verifier")
GEOMETRY = ("reconstructor", "prior", "axis", "fusion", "renderer")


def build_components(
    config: object,
    registry: Registry,
    choices: Mapping[str, str] | None = None,
    branch: BranchOptions | None = None,
) -> Components:
    """All components that the configuration chose; the caller closes the robot and the memory.

    ``choices`` are their names in the record, by default their names by group, without those that nothing uses here;
    ``branch`` the options of the reconstruction branch. A perceiver without a gallery gets the task's known objects.
    Raises :class:`ConfigurationError` for a camera that the robot would not use, for a parameter that no skill has, and
    for options of the reconstruction branch that nothing uses.
    """
    from gvla2.episode.loop import Components
    from gvla2.episode.refine import GeometryComponents
    from gvla2.planning.calls import SkillOptions
    from gvla2.reconstruction.options import BranchOptions
    from gvla2.skills.grounding import wrong_parameters

    camera, robot = (registry.chosen(config, kind) for kind in ("camera", "robot"))
    takers = [name for name, one in registry.components("robot").items() if "camera" in one.needs]
    if camera not in ("", NONE) and robot not in takers:
        raise ConfigurationError(
            f"camera={camera} does nothing with robot={robot}, which has cameras of its own. Robots that take one: "
            f"{', '.join(takers) or 'none is installed'}."
        )
    config = with_known_objects(config, registry)
    built: dict[str, Any] = {}
    registry.build_all(config, (*LOOP, "memory", *GEOMETRY), built)
    for kind in ("planner", "fallback"):
        options = getattr(config, kind, None)
        refusal = (
            wrong_parameters(options.parameters, registry.skills)
            if isinstance(options, SkillOptions)
            else None
        )
        if refusal is not None:  # once, and not as a failure of each episode
            raise ConfigurationError(f"{kind}.parameters: {refusal.message}")
    branch, refines = branch or BranchOptions(), registry.chosen(config, "reconstructor") != NONE
    if not refines:
        _refuse_unused(config, registry, branch)
    elif choices is None:  # an ablation's rows have stages of their own
        refuse_idle(config, registry, branch)
    if choices is None:
        offered = (one for kind in registry.kinds for one in registry.components(kind).values())
        idle = {need for one in offered for need in one.needs} - set(built)
        if not refines:
            idle.update(GEOMETRY[1:])
        choices = {kind: getattr(config, kind).name for kind in registry.groups if kind not in idle}
    geometry = GeometryComponents(**{kind: built[kind] for kind in GEOMETRY}, options=branch)
    offers = {kind: registry.offers(kind).get(name) for kind, name in choices.items()}
    return Components(
        **{kind: built[kind] for kind in (*LOOP, "memory")},
        geometry=geometry if refines else None,
        choices=choices,
        skills=registry.skills,
        language=built.get("language"),
        plugins={kind: offer.plugin.name for kind, offer in offers.items() if offer is not None},
    )


def with_known_objects(config: Any, registry: Registry) -> Any:
    """The configuration, a dataclass or a mapping, with the task's known objects as the gallery of its perceiver."""
    perceiver = config.get("perceiver") if isinstance(config, Mapping) else getattr(config, "perceiver", None)
    name = registry.chosen(config, "task")
    if (
        perceiver is None
        or getattr(perceiver, "gallery", None) != ""
        or name in ("", NONE)
        or OWN_TASK in name
    ):
        return config
    task, _ = registry.configure(config, "task")
    known = task.known_objects if isinstance(task, TaskConfig) else ""
    taught = {"perceiver": replace(perceiver, gallery=known)}
    return {**config, **taught} if isinstance(config, Mapping) else replace(config, **taught)


def refuse_idle(config: object, registry: Registry, branch: BranchOptions) -> None:
    """Raises :class:`ConfigurationError` for numbers of the soft hull, or a fusion, while that stage is off."""
    fusion = described(registry.configure(config, "fusion")[0])
    numbers = [f"branch.{name}" for name in branch.changed() if name in SOFT_HULL and not branch.soft_hull]
    other = [] if branch.fusion or fusion in (NONE, KINDS["fusion"].default) else [f"fusion={fusion}"]
    for stage, given in (("soft_hull", numbers), ("fusion", other)):
        if given:
            raise ConfigurationError(
                f"{', '.join(given)}: nothing uses this while branch.{stage} is off. Add branch.{stage}=true, or "
                "leave it out."
            )


def _refuse_unused(config: object, registry: Registry, branch: BranchOptions) -> None:
    """Raises :class:`ConfigurationError` where something was chosen that only a reconstructor's output goes through."""
    given = [f"branch.{name}={value}" for name, value in branch.changed().items()]
    for kind in GEOMETRY[1:]:
        chosen = described(registry.configure(config, kind)[0])
        given += [] if chosen == KINDS[kind].default else [f"{kind}={chosen}"]
    if given:
        raise ConfigurationError(
            f"{', '.join(given)}: without a reconstructor nothing uses this. Choose one, as in reconstructor=hull, or "
            "leave it out."
        )
