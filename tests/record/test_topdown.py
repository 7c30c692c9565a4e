import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene, SceneObject
from gvla2.record.contents import EpisodeRecord
from gvla2.record.topdown import side_map, top_map

SVG = "{http://www.w3.org/2000/svg}"
START = np.array([0.28, 0.0, 1.1])


def polygons(svg: str) -> list[np.ndarray]:
    found = ET.fromstring(svg).iter(f"{SVG}polygon")
    return [np.array([[float(v) for v in p.split(",")] for p in e.get("points", "").split()]) for e in found]


@pytest.mark.parametrize("draw", [top_map, side_map])
def test_maps_are_well_formed_and_complete(
    draw: Callable[..., str], episode: Callable[..., EpisodeRecord]
) -> None:
    record = episode()
    assert record.scene is not None
    svg = draw(record.scene, record.plan.trajectory if record.plan else None, START)
    text = "".join(ET.fromstring(svg).itertext())
    assert all(o.label in text for o in record.scene.objects)
    assert "100 mm" in text
    assert len(polygons(svg)) == len(record.scene.objects)


def test_footprints_keep_place_and_size(episode: Callable[..., EpisodeRecord]) -> None:
    scene = episode().scene
    assert scene is not None
    red, olive, plate = polygons(top_map(scene))
    side = np.linalg.norm(red[0] - red[1])
    assert np.linalg.norm(plate[0] - plate[1]) / side == pytest.approx(0.17 / 0.05, rel=0.02)
    # The plate lies at y = +0.20, left of the red cube at y = -0.10; the olive cube is further away: above.
    assert plate[:, 0].mean() < red[:, 0].mean()
    assert olive[:, 1].mean() < red[:, 1].mean()
    across = plate[:, 0].mean() - red[:, 0].mean()
    assert across / side == pytest.approx(-0.30 / 0.05, rel=0.02)


def test_things_stand_on_the_table_in_the_side_view(episode: Callable[..., EpisodeRecord]) -> None:
    scene = episode().scene
    assert scene is not None
    svg = side_map(scene)
    line = next(e for e in ET.fromstring(svg).iter(f"{SVG}line") if e.get("class") == "map-top")
    red = polygons(svg)[0]
    assert red[:, 1].max() == pytest.approx(float(line.get("y1", "0")), abs=0.5)


def test_hostile_labels_are_escaped(episode: Callable[..., EpisodeRecord]) -> None:
    scene = episode().scene
    assert scene is not None
    bad = replace(scene.objects[0], label='<script>"x"</script>')
    for draw in (top_map, side_map):
        svg = draw(scene.with_object(bad))
        assert "<script" not in svg
        ET.fromstring(svg)


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "disc", "other"])
def test_round_things_and_lone_things(shape: str, episode: Callable[..., EpisodeRecord]) -> None:
    scene = episode().scene
    assert scene is not None
    thing = SceneObject(
        "a", "", shape, "", rigid(translation=(0, 0, 0.8)), np.full(3, 0.06), np.zeros((0, 3))
    )  # type: ignore[arg-type]
    for draw in (top_map, side_map):
        assert "nan" not in draw(replace(scene, objects=(thing,)))


def test_an_empty_scene_is_a_map_too(episode: Callable[..., EpisodeRecord]) -> None:
    scene: Scene | None = episode().scene
    assert scene is not None
    for draw in (top_map, side_map):
        ET.fromstring(draw(replace(scene, objects=())))
