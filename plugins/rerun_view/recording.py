"""An episode as a recording of rerun: the world in 3D before and after, with the arm's joints in between.

* ``world/cameras/NAME``: pose and lens; below them image and depth
* ``world/seen``: points that the cameras measured, in and near the workspace
* ``world/objects/ID``: each object's body and its box with its name
* ``world/plan``: path and waypoints, red where a check failed
* ``arm/joints/K``, ``arm/gripper_width``: measured, radians and metres
* ``film``: the main camera's pictures

The time line "episode" has seconds since the first frame of the motion.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from gvla2.episode.record import EpisodeRecord
from gvla2.record.motion import FILM, STATES
from gvla2.record.scene_model import CLOSED, FAILED, OPEN, cloud, solid_of, waypoint_text

if TYPE_CHECKING:
    from gvla2.geometry.views import Observation
    from gvla2.planning.scene import Scene
    from gvla2_plugins.rerun_view import RerunConfig

LINE = "episode"


class RerunViewer:
    """Writes one file per episode; needs neither a window nor a server."""

    def __init__(self, config: RerunConfig) -> None:
        self._config = config

    def show(self, record: EpisodeRecord, folder: Path) -> None:
        """Write the recording of an episode that has ended beside its page."""
        folder.mkdir(parents=True, exist_ok=True)
        to = rr.RecordingStream("gvla2", recording_id=record.episode_id or None)
        to.save(folder / self._config.file)
        to.disable_timeline("log_time")
        to.disable_timeline("log_tick")
        to.send_recording_name(record.instruction)
        to.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        to.set_time(LINE, duration=0.0)
        self._moment(to, record.observation, record.scene)
        _plan(to, record)
        to.set_time(LINE, duration=_motion(to, folder))
        self._moment(to, record.after, record.after_scene)
        to.flush()
        to.disconnect()

    def _moment(self, to: rr.RecordingStream, seen: Observation | None, scene: Scene | None) -> None:
        for view in seen.views if seen is not None else ():
            path, camera = f"world/cameras/{_part(view.name)}", view.camera
            pose, size = camera.world_from_camera, [camera.width, camera.height]
            to.log(path, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
            to.log(path, rr.Pinhole(image_from_camera=camera.K, resolution=size, image_plane_distance=0.12))
            to.log(f"{path}/image", rr.Image(view.image).compress(jpeg_quality=90))
            if view.depth is not None:
                to.log(f"{path}/depth", rr.DepthImage(np.nan_to_num(view.depth), meter=1.0))
        if scene is None:
            return
        if seen is not None:
            points, colours = cloud(seen, scene.workspace, self._config.points)
            to.log("world/seen", rr.Points3D(points, colors=colours, radii=0.003))
        for obj in scene.objects:
            path, rgb = f"world/objects/{_part(obj.id)}", np.clip(np.nan_to_num(obj.rgb), 0, 1)
            body, pose = solid_of(obj), obj.world_from_object
            mesh = rr.Mesh3D(
                vertex_positions=body.vertices,
                triangle_indices=body.faces,
                vertex_normals=body.vertex_normals,
                albedo_factor=[*rgb, 1.0],
            )
            to.log(f"{path}/body", mesh)
            to.log(f"{path}/box", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
            box = rr.Boxes3D(sizes=[obj.extents], labels=[obj.label or obj.id], colors=[255 * rgb])
            to.log(f"{path}/box", box)


def _plan(to: rr.RecordingStream, record: EpisodeRecord) -> None:
    waypoints = () if record.plan is None else tuple(record.plan.trajectory or ())
    if not waypoints:
        return
    stops = [list(w.xyz) for w in waypoints]
    texts = [waypoint_text(k, waypoint, record.checks) for k, waypoint in enumerate(waypoints)]
    colours = [OPEN if w.gripper > 0.5 else CLOSED for w in waypoints]
    to.log("world/plan/path", rr.LineStrips3D([stops], radii=0.002), static=True)
    dots = rr.Points3D(
        stops,
        radii=0.008,
        colors=[FAILED if bad else colour for colour, (_, bad) in zip(colours, texts, strict=True)],
        labels=[text for text, _ in texts],
        show_labels=False,
    )
    to.log("world/plan/waypoints", dots, static=True)


def _motion(to: rr.RecordingStream, folder: Path) -> float:
    """The arm's states and the film; returns the seconds that the motion took."""
    if not (folder / STATES).is_file():
        return 0.0
    with np.load(folder / STATES) as kept:
        times, joints, widths = kept["time"] - kept["time"][0], kept["joints"], kept["gripper_width"]
        fps = float(kept["fps"])
    line = rr.TimeColumn(LINE, duration=times)
    for k in range(joints.shape[1]):
        to.send_columns(f"arm/joints/{k}", [line], rr.Scalars.columns(scalars=joints[:, k]))
    to.send_columns("arm/gripper_width", [line], rr.Scalars.columns(scalars=widths))
    if (folder / FILM).is_file():
        to.log("film", rr.AssetVideo(path=folder / FILM), static=True)
        frames = rr.VideoFrameReference.columns_secs(np.arange(len(times)) / fps)
        to.send_columns("film", [line], frames)
    return float(times[-1])


def _part(name: str) -> str:
    return str(rr.escape_entity_path_part(name))
