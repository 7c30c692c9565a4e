"""A result tree as a reconstructor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.geometry.view_spec import parse_rotation_word
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Reconstruction
from gvla2_plugins.sam3d.released_layout import result_folder
from gvla2_plugins.sam3d.result_tree import align_result, read_result

if TYPE_CHECKING:
    from gvla2_plugins.sam3d import ResultTreeConfig


class ResultTreeReconstructor:
    """Reads the tree again for each call, so that it may be filled while a sweep runs.

    Raises :class:`ConfigurationError` when root or object is not given or the axes cannot be read.
    """

    def __init__(self, config: ResultTreeConfig) -> None:
        for option in ("root", "object"):
            if not getattr(config, option):
                raise ConfigurationError(
                    f"reconstructor.{option} is empty: result_tree reads <root>/<object>/{config.views}views; "
                    "give both reconstructor.root=PATH and reconstructor.object=NAME."
                )
        if config.axes != "auto":
            parse_rotation_word(config.axes)
        elif not config.refine:
            raise ConfigurationError(
                "reconstructor.axes=auto finds the axes by the masks and so cannot do without reconstructor.refine."
            )
        self._config = config

    def reconstruct(self, views: Views) -> Reconstruction:
        """The result in the views' frame; a :class:`gvla2.errors.GeometryError` names the missing or broken part."""
        c = self._config
        result = read_result(result_folder(c.root, c.object, c.views))
        return align_result(result, views, c.axes, c.refine, c.gaussians)
