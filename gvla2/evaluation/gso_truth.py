"""The true shape of a GSO-30 object, put into the frame of its views."""

from __future__ import annotations

import logging
from pathlib import Path

from gvla2.evaluation.metrics import unit_box
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh, to_z_up
from gvla2.geometry.views import Views
from gvla2.reconstruction.silhouette import symmetric_iou

AGREEMENT = 0.9
"""Least symmetric IoU of the true shape's silhouettes and the masks; half a pixel at the edge costs some per cent."""

log = logging.getLogger(__name__)


def true_mesh(path: Path, views: Views) -> TriangleMesh | None:
    """The mesh of a file, scaled to a longest side of 1, centred, and turned as in the views.

    The views may have been rendered with the file as Y-up or as Z-up; the masks decide. None, with a warning, when
    there is no file or neither reading agrees with the masks: no Chamfer distance is better than a wrong one.
    """
    if not path.is_file():
        log.warning("%s is missing: no Chamfer distance for this object.", path)
        return None
    mesh = read_mesh(path)
    upright = mesh.with_vertices(unit_box(mesh.vertices))
    readings = (upright, upright.with_vertices(to_z_up(upright.vertices)))
    scores = [symmetric_iou(reading.vertices, views, faces=reading.faces) for reading in readings]
    best = max(range(len(readings)), key=scores.__getitem__)
    if scores[best] < AGREEMENT:
        log.warning(
            "%s does not agree with its views' masks (IoU %.3f): no Chamfer distance.", path, scores[best]
        )
        return None
    return readings[best]
