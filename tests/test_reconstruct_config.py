"""What can be asked of `gvla2 reconstruct`, and what cannot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.primary import all_schemas
from gvla2.commands.reconstruct import ReconstructConfig, read_inputs, spec_of
from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.view_folders import write_views
from gvla2.geometry.views import Views
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import Registry
from gvla2.reconstruction.options import BranchOptions
from gvla2.testing.inputs import RED
from gvla2.testing.inputs import views as table_views


@pytest.fixture(autouse=True)
def _registered(registry: Registry) -> None:
    register(registry, all_schemas())


def composed(*overrides: str) -> ReconstructConfig:
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("reconstruct", overrides=list(overrides)))
    assert isinstance(config, ReconstructConfig)
    return config


@pytest.mark.parametrize("command", ["run", "reconstruct", "bench"])
def test_the_branch_is_one_group_of_three_commands(command: str):
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        chosen = OmegaConf.to_object(compose(command, overrides=["branch=paper", "branch.axis=false"]))
    assert chosen.branch == BranchOptions(mode="paper", axis=False)


@pytest.mark.parametrize(
    ("word", "spec"), [("0-4", "0-4"), ("7", "7"), ("[0-4,7]", "0-4,7"), ("'0-4,7'", "0-4,7"), ("null", None)]
)
def test_view_specs_as_the_command_line_has_them(word: str, spec: str | None):
    assert composed(f"views_spec={word}").views_spec == spec


@pytest.mark.parametrize("value", [True, 1.5, {"a": 1}])
def test_what_is_no_view_spec(value: object):
    with pytest.raises(ConfigurationError, match="write views such as"):
        spec_of("views_spec", value)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("branch.mode=papr", "branch.mode is 'papr'; it is one of default, paper"),
        ("branch.eta=0", "eta > 0"),
        ("size=4", "at least 8"),
        ("frames=1", "2 to 120"),
    ],
)
def test_values_that_cannot_be_are_refused(word: str, message: str):
    with pytest.raises(ConfigurationError, match=message):
        composed(word)


def test_an_origin_far_away_is_refused(tmp_path: Path):
    """As in geodesy, where 32-bit numbers have steps of decimetres."""
    away = np.array([5e5, 4.2e6, 0.0])
    moved = []
    for view in table_views():
        pose = view.camera.world_from_camera.copy()
        pose[:3, 3] += away
        mask = np.ones(view.image.shape[:2], np.float32)
        moved.append(replace(view, mask=mask, camera=replace(view.camera, world_from_camera=pose)))
    write_views(tmp_path, Views(tuple(moved)))
    with pytest.raises(GeometryError, match=r"4\.23e\+06 from the world's origin.*put the origin near"):
        read_inputs(composed(f"views={tmp_path}"))


def test_another_object_than_the_masks_show_is_refused(tmp_path: Path):
    write_views(tmp_path, table_views(40, masked=RED), "red cube")
    for words in ("object=nope", "object='green cube'"):
        with pytest.raises(ConfigurationError, match="show one object: 'red cube'"):
            read_inputs(composed(f"views={tmp_path}", words))
    assert read_inputs(composed(f"views={tmp_path}", "object='Red cube'")).name == "Red cube"
