"""Tasks on a table, re-authored from published sizes: fourteen of a simulated suite, three of a real robot's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gvla2 import Component, hookimpl
from gvla2.errors import ConfigurationError
from gvla2.robot.options import TaskConfig

if TYPE_CHECKING:
    from gvla2.robot.task import Task
    from gvla2_plugins.tabletop.scenes import TabletopTask


@dataclass
class ScaledConfig(TaskConfig):
    """Options of every task here. ``scale`` multiplies the sizes of the objects on the table, 0.8 to 1.2 (lids to be
    shut: to 1.05, as far as a hand pointing down reaches).

    Sizes and distances stay within the hand's span and the arm's reach at any scale.

    ``world`` learnable draws how objects behave by family (docs/learnable_worlds.md): ``world_seed`` is the world's,
    ``families`` how many there are of the task's kind, ``family`` the episodes' family (-1: any). ``drifted``: half of
    the families behave otherwise than before; ``twins``: both families have one colour and differ in size.
    """

    scale: float = 1.0
    world: str = "plain"
    world_seed: int = 0
    families: int = 2
    family: int = -1
    drifted: bool = False
    twins: bool = False

    def factor(self, task: str, most: float) -> float:
        """The scale, checked; raises :class:`ConfigurationError` when it is out of range."""
        if not 0.8 <= self.scale <= most:
            raise ConfigurationError(f"task={task} takes task.scale from 0.8 to {most}, got {self.scale}.")
        return self.scale


@dataclass
class OpenJarConfig(ScaledConfig):
    """Options of ``open_jar``. ``turn`` (degrees, counter-clockwise) is where the lid comes loose.

    It is slightly less than the wrist's quarter turn, since fingers slip.
    """

    turn: float = 80.0


@dataclass
class OpenBoxConfig(ScaledConfig):
    """Options of ``open_box``. ``swing`` (radians): boxes stand where the arm can open their lids by that much."""

    swing: float = 1.8


_TASKS: tuple[tuple[str, type[ScaledConfig], str], ...] = (
    ("put_block", ScaledConfig, "Put a block on a painted square."),
    ("push_block", ScaledConfig, "Push a block onto a square painted on the table."),
    ("play_jenga", ScaledConfig, "Pull the loose brick out of a tower that keeps standing."),
    ("open_jar", OpenJarConfig, "Unscrew the lid of the jar of the named colour."),
    ("close_box", ScaledConfig, "Close the hinged lid of a box."),
    ("open_box", OpenBoxConfig, "Open the hinged lid of a box by its lip."),
    ("pickup_cup", ScaledConfig, "Pick the cup of the named colour up by its rim."),
    ("take_umbrella", ScaledConfig, "Pull an umbrella out of its stand."),
    ("sort_mustard", ScaledConfig, "Put the mustard bottle into the tray."),
    ("open_wine", ScaledConfig, "Turn the cap of a wine bottle until it comes off."),
    ("lamp_on", ScaledConfig, "Press the sprung button of a lamp."),
    ("put_knife", ScaledConfig, "Draw a knife from its block and lay it on the board."),
    ("pick_and_lift", ScaledConfig, "Lift the cube of the named colour, beside others."),
    ("insert_block", ScaledConfig, "Slip a ring over the pillar of the named colour."),
    ("open_drawer", ScaledConfig, "Pull a drawer open by its handle."),
    ("sort_object", ScaledConfig, "Put three objects into the bins of their colours."),
)
"""Name, configuration, summary."""


def _component(name: str, config: type[ScaledConfig], summary: str) -> Component[Task]:
    def build(config: ScaledConfig) -> Task:
        from gvla2_plugins.tabletop import furniture as f
        from gvla2_plugins.tabletop import lift as li
        from gvla2_plugins.tabletop import put as p
        from gvla2_plugins.tabletop import screws, towers
        from gvla2_plugins.tabletop.learnable import Learnable

        tasks: tuple[type[TabletopTask[Any]], ...] = (
            f.CloseBox, f.OpenBox, f.OpenDrawer, li.LampOn, li.PickAndLift, li.PickupCup, li.PushBlock, li.TakeUmbrella,
            p.PutBlock, p.PutKnife, p.SortMustard, p.SortObject, screws.OpenJar, screws.OpenWine, towers.InsertBlock,
            towers.PlayJenga,
        )  # fmt: skip
        task = next(task for task in tasks if task.name == name)
        return task(config) if config.world == "plain" else Learnable(config, task)

    return Component(name, config, build, summary=summary)


@hookimpl
def gvla2_tasks() -> list[Component[Task]]:
    """The tabletop tasks."""
    return [_component(*row) for row in _TASKS]
