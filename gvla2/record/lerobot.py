"""Data sets for training in LeRobot's layout v3.0: Parquet, one mp4 per episode, and their metadata.

    meta/info.json, stats.json, tasks.parquet, episodes/chunk-000/file-000.parquet
    data/chunk-000/file-000.parquet
    videos/observation.images.main/chunk-000/file-NNN.mp4

State and action are the arm's joints in radians and the fingers' opening in metres: the state as measured at a frame,
the action the state at the next one (the last repeats its own), as for arms that are sent absolute joint targets.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from gvla2.errors import Gvla2Error, reading
from gvla2.io.files import make_folder, write_json
from gvla2.record.page import render

VIDEO = "observation.images.main"
_CHUNK = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_FILES_A_CHUNK = 1000


@dataclass(frozen=True)
class VideoFile:
    """A film's file, its number of ``frames``, their ``size`` (H, W), and their colours' statistics.

    ``low`` and ``high`` (3,) are the least and the greatest, ``total`` and ``squares`` (3,) the sums of ``pixels``
    colours in [0, 1] and of their squares.
    """

    path: Path
    frames: int
    size: tuple[int, int]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    total: NDArray[np.float64]
    squares: NDArray[np.float64]
    pixels: int

    @classmethod
    def read(cls, path: Path) -> VideoFile:
        """Read a film one frame at a time; raises :class:`Gvla2Error` for a file that is none."""
        with reading("a film", path, Gvla2Error):
            reader: Any = imageio_ffmpeg.read_frames(str(path))
            width, height = next(reader)["size"]
            frames = pixels = 0
            low, high, total, squares = np.ones(3), np.zeros(3), np.zeros(3), np.zeros(3)
            for frame in reader:
                rgb = (
                    np.frombuffer(frame, np.uint8).reshape(height, width, 3)[::4, ::4].reshape(-1, 3) / 255.0
                )
                low, high = np.minimum(low, rgb.min(0)), np.maximum(high, rgb.max(0))
                total, squares = total + rgb.sum(0), squares + (rgb**2).sum(0)
                frames, pixels = frames + 1, pixels + len(rgb)
            if not frames:
                raise Gvla2Error("it has no frames.")
        return cls(path, frames, (height, width), low, high, total, squares, pixels)


@dataclass(frozen=True)
class Demonstration:
    """One episode: ``states`` (T, dof + 1) joints and opening, its ``film`` of T frames at ``fps``, its sentence; the
    ``robot`` by name, and ``source``, what else distinguishes arms and cameras.

    Raises :class:`Gvla2Error` for a film with another number of frames.
    """

    states: NDArray[np.float32]
    fps: float
    film: VideoFile
    task: str
    robot: str
    source: str = ""

    def __post_init__(self) -> None:
        if self.film.frames != len(self.states):
            raise Gvla2Error(f"{self.film.path} has {self.film.frames} frames for {len(self.states)} states.")

    @property
    def actions(self) -> NDArray[np.float32]:
        """(T, dof + 1), the state one frame later."""
        return np.concatenate([self.states[1:], self.states[-1:]])


def write_dataset(folder: Path, episodes: Sequence[Demonstration]) -> None:
    """Write the data set into an empty or missing ``folder``.

    Raises :class:`Gvla2Error` for no episodes, for a folder that is not empty, and for episodes of different arms,
    rates or picture sizes, which one data set cannot hold.
    """
    if not episodes:
        raise Gvla2Error("There is no episode to export.")
    if folder.exists() and any(folder.iterdir()):
        raise Gvla2Error(f"The folder '{folder}' is not empty: name a new one with to=FOLDER.")
    kinds = {
        (", ".join(filter(None, (e.robot, e.source))), e.fps, e.states.shape[1], e.film.size)
        for e in episodes
    }
    if len(kinds) > 1:
        kinds_found = "; ".join(
            f"{robot}, {fps:g} Hz, {n} numbers, {h}x{w}" for robot, fps, n, (h, w) in sorted(kinds)
        )
        raise Gvla2Error(
            f"One data set holds one arm at one rate and picture size, not several: {kinds_found}."
        )
    make_folder(folder)
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    for index, episode in enumerate(episodes):
        place = folder / "videos" / VIDEO / _place(index)
        make_folder(place.parent)
        shutil.copyfile(episode.film.path, place.with_suffix(".mp4"))
    _write(folder / "data" / _place(0), _data(episodes, tasks))
    _write(folder / "meta" / "episodes" / _place(0), _episodes(episodes))
    _write(folder / "meta" / "tasks", _tasks(tasks))
    names = [*(f"joint_{k}.pos" for k in range(1, episodes[0].states.shape[1])), "gripper.width"]
    layout = {"video": VIDEO, "chunk": _CHUNK, "chunk_size": _FILES_A_CHUNK, "size": episodes[0].film.size}
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


def _episodes(episodes: Sequence[Demonstration]) -> pa.Table:
    ends = np.cumsum([len(episode.states) for episode in episodes])
    rows = [
        {
            "episode_index": index,
            "tasks": [episode.task],
            "length": len(episode.states),
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": int(end) - len(episode.states),
            "dataset_to_index": int(end),
            f"videos/{VIDEO}/chunk_index": index // _FILES_A_CHUNK,
            f"videos/{VIDEO}/file_index": index % _FILES_A_CHUNK,
            f"videos/{VIDEO}/from_timestamp": 0.0,
            f"videos/{VIDEO}/to_timestamp": len(episode.states) / episode.fps,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for index, (episode, end) in enumerate(zip(episodes, ends, strict=True))
    ]
    return pa.Table.from_pylist(rows)


def _tasks(tasks: Sequence[str]) -> pa.Table:
    """LeRobot reads a frame of pandas whose index is the sentence: its metadata is written manually."""
    numbers, words = pa.array(range(len(tasks)), pa.int64()), pa.array(tasks, pa.string())
    table = pa.table({"task_index": numbers, "__index_level_0__": words})
    return table.replace_schema_metadata({b"pandas": render("lerobot_tasks.json.jinja").strip().encode()})


def _stats(episodes: Sequence[Demonstration]) -> dict[str, Any]:
    """Minimum, maximum, mean, standard deviation and count; of pictures by channel, in [0, 1]."""
    count = sum(len(episode.states) for episode in episodes)
    stats: dict[str, Any] = {}
    for name, rows in (
        ("observation.state", [episode.states for episode in episodes]),
        ("action", [episode.actions for episode in episodes]),
    ):
        exact = np.concatenate(rows).astype(np.float64)
        stats[name] = {"min": exact.min(0), "max": exact.max(0), "mean": exact.mean(0), "std": exact.std(0)}
    films = [episode.film for episode in episodes]
    pixels = sum(film.pixels for film in films)
    mean = sum((film.total for film in films), np.zeros(3)) / pixels
    spread = sum((film.squares for film in films), np.zeros(3)) / pixels - mean**2
    colours = {
        "min": np.min([film.low for film in films], axis=0),
        "max": np.max([film.high for film in films], axis=0),
        "mean": mean,
        "std": np.sqrt(np.maximum(spread, 0.0)),
    }
    stats[VIDEO] = {name: value.reshape(3, 1, 1) for name, value in colours.items()}
    return {name: {**numbers, "count": [count]} for name, numbers in stats.items()}
