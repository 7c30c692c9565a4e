"""Data sets for training in LeRobot's layout v3.0: Parquet, an mp4 per episode and camera, and their metadata.

    meta/info.json, stats.json, tasks.parquet, episodes/chunk-000/file-000.parquet
    data/chunk-000/file-000.parquet
    videos/observation.images.CAMERA/chunk-000/file-NNN.mp4

State and action are the arm's joints in radians and the width between the fingers in metres: the state as measured at
a frame, the action what the robot is driven to at the next one (the last repeats its own), which an environment with
``control="joint_position"`` takes unchanged. Of a robot that does not know what it is driven to, it is the next state.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gvla2.errors import Gvla2Error, OutputError, reading
from gvla2.io.files import make_folder, write_json
from gvla2.record.motion import Film, check_whole, even, opened
from gvla2.record.page import render

PICTURES = "observation.images."
"""Before a camera's name."""
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
EVERY = 4
"""Of a film's pixels, one in so many rows and columns counts for the statistics."""
_CHUNK = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_FILES_A_CHUNK = 1000


@dataclass(frozen=True)
class VideoFile:
    """A film's file, its number of ``frames``, their ``size`` (H, W), and how often each colour occurs in the picture
    of each of its ``cameras``, which are side by side: ``colours`` (cameras, 3, 256).
    """

    path: Path
    cameras: tuple[str, ...]
    frames: int
    size: tuple[int, int]
    colours: NDArray[np.int64]

    @classmethod
    def read(cls, path: Path, cameras: Sequence[str]) -> VideoFile:
        """Read a film one frame at a time; raises :class:`Gvla2Error` for a file that is none."""
        with reading("a film", path, Gvla2Error):
            frames, size = 0, (0, 0)
            colours = np.zeros((len(cameras), 3, 256), np.int64)
            for frame in _frames(path):
                pictures = _pictures(frame, len(cameras))
                for k, picture in enumerate(pictures):
                    pixels = picture[::EVERY, ::EVERY].reshape(-1, 3)
                    colours[k] += [np.bincount(channel, minlength=256) for channel in pixels.T]
                frames, size = frames + 1, pictures[0].shape[:2]
            if not frames:
                raise Gvla2Error("it has no frames.")
        return cls(path, tuple(cameras), frames, size, colours)

    def write(self, places: Sequence[Path], fps: float) -> None:
        """Write the film of each camera."""
        if len(places) == 1:
            shutil.copyfile(self.path, places[0])
            return
        films: list[Film] = []
        for frame in _frames(self.path):
            pictures = _pictures(frame, len(places))
            films = films or [opened(*one, fps) for one in zip(places, pictures, strict=True)]
            for film, picture in zip(films, pictures, strict=True):
                film.send(picture.tobytes())
        for film, place in zip(films, places, strict=True):
            film.close()
            check_whole(place)


def _frames(path: Path) -> Iterator[NDArray[np.uint8]]:
    """The pictures (H, W, 3) of a film, one at a time."""
    reader: Any = imageio_ffmpeg.read_frames(str(path))
    width, height = next(reader)["size"]
    for frame in reader:
        yield np.frombuffer(frame, np.uint8).reshape(height, width, 3)


def _pictures(frame: NDArray[np.uint8], cameras: int) -> list[NDArray[np.uint8]]:
    """The pictures of cameras side by side, cropped to even sides as encoders require."""
    return [even(picture) for picture in np.split(frame, cameras, axis=1)]


@dataclass(frozen=True)
class Demonstration:
    """One episode: ``states`` (T, dof + 1) joints and opening, its ``film`` of T frames at ``fps``, its sentence; the
    ``robot`` by name, and ``source``, what else distinguishes arms and cameras; ``commands`` (T, dof + 1) what the
    robot was driven to, if that is known; ``labels`` are columns of the episode's row: seed, run, success and failure.

    Raises :class:`Gvla2Error` for a film with another number of frames, and for numbers that no policy can learn from.
    """

    states: NDArray[np.float32]
    fps: float
    film: VideoFile
    task: str
    robot: str
    source: str = ""
    commands: NDArray[np.float32] | None = None
    labels: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.film.frames != len(self.states):
            raise Gvla2Error(f"{self.film.path} has {self.film.frames} frames for {len(self.states)} states.")
        goals = self.states if self.commands is None else self.commands
        if goals.shape != self.states.shape:
            raise Gvla2Error(f"{self.film.path}: commands {goals.shape} for states {self.states.shape}.")
        if not (np.isfinite([self.states, goals]).all() and 0 < self.fps < np.inf):
            raise Gvla2Error(
                f"{self.film.path}: states or commands not finite, or no rate ({self.fps:g} Hz)."
            )

    @property
    def actions(self) -> NDArray[np.float32]:
        """(T, dof + 1), the command of one frame later."""
        goals = self.states if self.commands is None else self.commands
        return np.concatenate([goals[1:], goals[-1:]])


def write_dataset(folder: Path, episodes: Sequence[Demonstration]) -> None:
    """Write the data set into an empty or missing ``folder``, whole or not at all.

    Raises :class:`Gvla2Error` for no episodes, for a folder that is not empty, and for episodes of different arms,
    rates or picture sizes, which one data set cannot hold; :class:`OutputError` when it cannot be written.
    """
    if not episodes:
        raise Gvla2Error("There is no episode to export.")
    if folder.exists() and any(folder.iterdir()):
        raise Gvla2Error(f"The folder '{folder}' is not empty: name a new one with to=FOLDER.")
    kinds = {
        (", ".join(filter(None, (e.robot, e.source, *e.film.cameras))), e.fps, e.states.shape[1], e.film.size)
        for e in episodes
    }
    if len(kinds) > 1:
        kinds_found = "; ".join(
            f"{robot}, {fps:g} Hz, {n} numbers, {h}x{w}" for robot, fps, n, (h, w) in sorted(kinds)
        )
        raise Gvla2Error(
            f"One data set holds one arm at one rate and picture size; name the folders of one of these: {kinds_found}."
        )
    aside = folder.absolute().with_name(f".{folder.absolute().name}.unfinished")
    try:
        lock = os.open(make_folder(aside), os.O_RDONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for old in aside.iterdir():  # of an export that was killed
                shutil.rmtree(old)
            _write_whole(aside, episodes)
            aside.replace(folder)
        except BlockingIOError:
            raise Gvla2Error(f"Another export writes the data set '{folder}' now.") from None
        except BaseException:
            shutil.rmtree(aside, ignore_errors=True)
            raise
        finally:
            os.close(lock)
    except OSError as error:
        raise OutputError(f"The data set '{folder}' cannot be written: {error.strerror or error}.") from error


def _write_whole(folder: Path, episodes: Sequence[Demonstration]) -> None:
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    cameras = [PICTURES + name for name in episodes[0].film.cameras]
    for index, episode in enumerate(episodes):
        places = [folder / "videos" / name / f"{_place(index)}.mp4" for name in cameras]
        for place in places:
            make_folder(place.parent)
        episode.film.write(places, episode.fps)
    _write(folder / "data" / _place(0), _data(episodes, tasks))
    _write(folder / "meta" / "episodes" / _place(0), _episodes(episodes, cameras))
    _write(folder / "meta" / "tasks", _tasks(tasks))
    names = [*(f"joint_{k}.pos" for k in range(1, episodes[0].states.shape[1])), "gripper.width"]
    layout = {"videos": cameras, "chunk": _CHUNK, "chunk_size": _FILES_A_CHUNK, "size": episodes[0].film.size}
    held = {"episodes": episodes, "first": episodes[0], "tasks": tasks, "names": names}
    info = render("lerobot_info.json.jinja", **layout, **held)
    write_json(folder / "meta" / "info.json", json.loads(info))
    write_json(folder / "meta" / "stats.json", _stats(episodes))


def _place(index: int) -> str:
    return _CHUNK.format(chunk_index=index // _FILES_A_CHUNK, file_index=index % _FILES_A_CHUNK)


def _write(place: Path, table: pa.Table) -> None:
    make_folder(place.parent)
    pq.write_table(table, place.with_suffix(".parquet"))


def _data(episodes: Sequence[Demonstration], tasks: Sequence[str]) -> pa.Table:
    lengths = [len(episode.states) for episode in episodes]
    frames = np.concatenate([np.arange(n) for n in lengths])
    columns = {
        "observation.state": _vectors([episode.states for episode in episodes]),
        "action": _vectors([episode.actions for episode in episodes]),
        "timestamp": (frames / episodes[0].fps).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.repeat(np.arange(len(episodes)), lengths),
        "index": np.arange(sum(lengths)),
        "task_index": np.repeat([tasks.index(episode.task) for episode in episodes], lengths),
    }
    return pa.table(columns)


def _vectors(rows: Sequence[NDArray[np.float32]]) -> pa.FixedSizeListArray:
    numbers = np.concatenate(rows).astype(np.float32)
    return pa.FixedSizeListArray.from_arrays(pa.array(numbers.ravel()), numbers.shape[1])


def _episodes(episodes: Sequence[Demonstration], cameras: Sequence[str]) -> pa.Table:
    ends = np.cumsum([0, *(len(episode.states) for episode in episodes)]).tolist()
    rows = [
        {
            "episode_index": index,
            "tasks": [episode.task],
            "length": len(episode.states),
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": first,
            "dataset_to_index": end,
            **{
                f"videos/{name}/{key}": value
                for name in cameras
                for key, value in (
                    ("chunk_index", index // _FILES_A_CHUNK),
                    ("file_index", index % _FILES_A_CHUNK),
                    ("from_timestamp", 0.0),
                    ("to_timestamp", len(episode.states) / episode.fps),
                )
            },
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            **episode.labels,
        }
        for index, (episode, (first, end)) in enumerate(zip(episodes, pairwise(ends), strict=True))
    ]
    return pa.Table.from_pylist(rows)


def _tasks(tasks: Sequence[str]) -> pa.Table:
    """LeRobot reads a frame of pandas whose index is the sentence: its metadata is written manually."""
    numbers, words = pa.array(range(len(tasks)), pa.int64()), pa.array(tasks, pa.string())
    table = pa.table({"task_index": numbers, "__index_level_0__": words})
    return table.replace_schema_metadata({b"pandas": render("lerobot_tasks.json.jinja").strip().encode()})


def _stats(episodes: Sequence[Demonstration]) -> dict[str, Any]:
    """Minimum, maximum, mean, standard deviation, quantiles and count; of pictures by channel, in [0, 1]."""
    count = sum(len(episode.states) for episode in episodes)
    stats: dict[str, Any] = {}
    for name, rows in (
        ("observation.state", [episode.states for episode in episodes]),
        ("action", [episode.actions for episode in episodes]),
    ):
        exact = np.concatenate(rows).astype(np.float64)
        stats[name] = {
            **{"min": exact.min(0), "max": exact.max(0), "mean": exact.mean(0), "std": exact.std(0)},
            **{quantile: np.quantile(exact, share, axis=0) for quantile, share in QUANTILES.items()},
        }
    films = [episode.film for episode in episodes]
    for camera, often in zip(films[0].cameras, np.sum([film.colours for film in films], axis=0), strict=True):
        stats[PICTURES + camera] = _of_colours(often)
    return {name: {**numbers, "count": [count]} for name, numbers in stats.items()}


def _of_colours(often: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    """Statistics (3, 1, 1) of colours in [0, 1] from how often each of 256 occurs in each channel (3, 256)."""
    level, below = np.arange(256) / 255.0, often.cumsum(1) / often.sum(1, keepdims=True)
    mean = often @ level / often.sum(1)
    spread = often @ level**2 / often.sum(1) - mean**2
    found = {
        "min": level[(often > 0).argmax(1)],
        "max": level[255 - (often > 0)[:, ::-1].argmax(1)],
        "mean": mean,
        "std": np.sqrt(np.maximum(spread, 0.0)),
        **{quantile: level[(below >= share).argmax(1)] for quantile, share in QUANTILES.items()},
    }
    return {name: value.reshape(3, 1, 1) for name, value in found.items()}
