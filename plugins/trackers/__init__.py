"""Runs reported to MLflow, Weights & Biases or TensorBoard: ``gvla2 run tracker=mlflow``. Off by default."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import MissingDependencyError

if TYPE_CHECKING:
    from gvla2.record.tracker import Tracker

INSTALL = "pip install 'gvla2[track]'"


@dataclass
class MLflowConfig(ComponentConfig):
    """Options of ``mlflow``: ``uri`` of a server, "" for the file ``outputs/mlflow.db``; the ``experiment``'s name.

    ``files`` sends each episode's page, result and picture as well; without a server they come into ``mlruns``.
    """

    uri: str = ""
    experiment: str = "gvla2"
    files: bool = True


@dataclass
class WandbConfig(ComponentConfig):
    """Options of ``wandb``: ``project`` and ``entity`` ("" for your own); ``mode`` is online, offline or disabled, ""
    for what ``WANDB_MODE`` says.

    ``files`` sends each episode's page, result and picture as well.
    """

    project: str = "gvla2"
    entity: str = ""
    mode: str = ""
    files: bool = True


@dataclass
class TensorBoardConfig(ComponentConfig):
    """Options of ``tensorboard``: events go to ``folder``, "" for ``tensorboard`` in the run's own."""

    folder: str = ""


def _mlflow(config: MLflowConfig) -> Tracker:
    """Reports to MLflow: configuration, numbers of each episode, pages."""
    from gvla2_plugins.trackers.services import MLflowTracker

    with _needing("mlflow", "Apache-2.0"):
        return MLflowTracker(config)


def _wandb(config: WandbConfig) -> Tracker:
    """Reports to Weights & Biases: configuration, numbers of each episode, pages."""
    from gvla2_plugins.trackers.services import WandbTracker

    with _needing("wandb", "MIT"):
        return WandbTracker(config)


def _tensorboard(config: TensorBoardConfig) -> Tracker:
    """Writes TensorBoard's events: configuration, numbers of each episode, the last picture."""
    from gvla2_plugins.trackers.services import TensorBoardTracker

    with _needing("tensorboardX", "MIT"):
        return TensorBoardTracker(config)


@contextmanager
def _needing(package: str, licence: str) -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        name = package.removesuffix("X")
        raise MissingDependencyError(package, f"tracker={name}", INSTALL, licence) from error


@hookimpl
def gvla2_trackers() -> list[Component[Tracker]]:
    """``tracker=mlflow``, ``wandb`` and ``tensorboard``."""
    return [
        Component("mlflow", MLflowConfig, _mlflow),
        Component("wandb", WandbConfig, _wandb),
        Component("tensorboard", TensorBoardConfig, _tensorboard),
    ]
