"""What `gvla2 reconstruct` starts from: the input views, views to judge by, and a true mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gvla2.commands.reconstruct import NO_TARGETS, ReconstructConfig
from gvla2.errors import ConfigurationError, GeometryError
from gvla2.evaluation.datasets import true_mesh
from gvla2.evaluation.protocol import TARGETS
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh
from gvla2.geometry.view_folders import ARCHIVE, read_views, subject_of
from gvla2.geometry.view_formats import find_cameras, find_model_folder
from gvla2.geometry.views import Views
from gvla2.reconstruction.support import mask_support

LEAST_TRUTH_SUPPORT = 0.3
"""Mean mask support below which a true mesh is assumed to be in another frame; masks may be occluded in part."""
FARTHEST = 1e4
"""Most that cameras may lie from the world's origin, in their distance from one another."""
GSO_TRUTH = Path("meshes") / "model.obj"


@dataclass(frozen=True)
class Inputs:
    """``views`` all have masks, at least one of them not empty; ``truth`` lies in their frame.

    ``held_out`` shares no view with them. ``truth_file`` is where the truth was read, "" for none.
    """

    name: str
    folder: Path
    views: Views
    held_out: Views | None
    truth: TriangleMesh | None
    truth_file: str


def read_inputs(config: ReconstructConfig) -> Inputs:
    """Everything that the configuration names, read and checked.

    Raises :class:`ConfigurationError` without a folder, :class:`GeometryError` for files that cannot be used.
    """
    if not config.views:
        raise ConfigurationError(
            "Say which views to reconstruct from: gvla2 reconstruct views=FOLDER. `gvla2 reconstruct --help` lists "
            "the kinds of folders, docs/reconstruction.md says what is in them."
        )
    folder = Path(config.views).expanduser()
    views = _masked(read_views(folder, config.views_spec, config.size), folder)
    held_out = _held_out(folder, config, views)
    truth, truth_file = _truth(folder, config, views)
    shown = subject_of(folder / ARCHIVE)
    if config.object and shown and config.object.casefold() != shown.casefold():
        raise ConfigurationError(
            f"object is '{config.object}', and the masks in {folder / ARCHIVE} show one object: '{shown}'. Leave "
            f"object= out, or give the folder of a run that is about '{config.object}'."
        )
    name = config.object or shown or folder.resolve().name
    return Inputs(name, folder, views, held_out, truth, truth_file)


def _masked(views: Views, folder: Path) -> Views:
    bare = [view.name for view in views if view.mask is None]
    if bare:
        raise GeometryError(
            f"{folder}: the views {', '.join(bare)} have no mask. The object's silhouette is needed in every view: "
            "save transparent PNG files, or put masks/<name>.png beside images/."
        )
    if not any(view.mask is not None and (view.mask > 0.5).any() for view in views):
        raise GeometryError(f"{folder}: all {len(views)} masks are empty, so no view shows the object.")
    places = np.array([view.camera.world_from_camera[:3, 3] for view in views])
    far, wide = float(np.linalg.norm(places, axis=1).max()), float(np.linalg.norm(np.ptp(places, axis=0)))
    if wide > 0 and far > FARTHEST * wide:
        raise GeometryError(
            f"{folder}: the cameras lie {far:.4g} from the world's origin and {wide:.4g} from one another. Files of "
            "32-bit numbers cannot tell an object's points apart there: put the origin near the object."
        )
    return views


def _held_out(folder: Path, config: ReconstructConfig, views: Views) -> Views | None:
    """The requested views, else those of a GSO-30 tree's protocol that exist and are not inputs."""
    if config.targets == NO_TARGETS:
        return None
    if config.targets is not None:
        held_out = read_views(folder, config.targets, config.size)
        shared = {view.name for view in views} & {view.name for view in held_out}
        if shared:
            raise GeometryError(
                f"The views {', '.join(sorted(shared))} are both input and target; choose other targets."
            )
        return held_out
    model = _gso_model(folder)
    if model is None:
        return None
    used = {int(view.name) for view in views}
    numbers = [n for n in TARGETS if n not in used and (model / f"{n:03d}.npy").is_file()]
    return read_views(folder, ",".join(map(str, numbers)), config.size) if numbers else None


def _gso_model(folder: Path) -> Path | None:
    """Where the numbered views lie when the folder is read as an object of a GSO-30 tree."""
    other = find_cameras(folder) is not None or (folder / ARCHIVE).is_file()
    return None if other else find_model_folder(folder)


def _truth(folder: Path, config: ReconstructConfig, views: Views) -> tuple[TriangleMesh | None, str]:
    """The true mesh in the views' frame; a GSO-30 tree brings its own, scaled and turned as its views were."""
    if config.truth:
        given = read_mesh(Path(config.truth).expanduser())
        support = float(mask_support(given.vertices, views).mean())
        if support < LEAST_TRUTH_SUPPORT:
            raise GeometryError(
                f"{config.truth} lies outside the masks (mean mask support {support:.2f}): truth must be in the views' "
                "frame and scale."
            )
        return given, config.truth
    brought = folder / GSO_TRUTH
    mesh = true_mesh(brought, views) if _gso_model(folder) is not None and brought.is_file() else None
    return mesh, "" if mesh is None else str(brought)
