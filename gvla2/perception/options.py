"""What every perceiver that names things can be told: ``perceiver.gallery=FOLDER perceiver.vision.base_url=...``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.language.options import EndpointOptions

if TYPE_CHECKING:
    from gvla2.language.endpoint import LanguageModel
    from gvla2.perception.labels import Labeller


@dataclass(kw_only=True)
class VisionOptions(EndpointOptions):
    """A model that sees, at an OpenAI-compatible address of its own: planners may ask another. "" is none.

    ``scale`` is what its coordinates count to: 1, 1000 for Qwen3-VL or Gemini.
    """

    base_url: str = ""
    scale: float = 1000.0
    longest: int = 1024


@dataclass(kw_only=True)
class NamingOptions:
    """Where names come from, besides colour and shape.

    ``gallery``: a folder of scans (.obj, .glb, .ply) of known objects, "" for none. ``read_crops``: whether the model
    at ``vision`` reads crops of what the gallery does not know.
    """

    gallery: str = ""
    read_crops: bool = False
    vision: VisionOptions = field(default_factory=VisionOptions)


def vision_model(options: VisionOptions, wanted_by: str) -> LanguageModel:
    """The model that sees; raises :class:`ConfigurationError` where none is given."""
    from gvla2.language.endpoint import Endpoint

    if not options.base_url:
        raise ConfigurationError(
            f"{wanted_by} needs a model that sees: perceiver.vision.base_url=http://127.0.0.1:8000/v1."
        )
    return Endpoint(options)


def labellers(options: NamingOptions) -> tuple[Labeller, ...]:
    """The sources of names that were asked for, the surest kind first."""
    found: list[Labeller] = []
    if options.gallery:
        from gvla2.perception.gallery import Gallery

        found.append(Gallery(options.gallery))
    if options.read_crops:
        from gvla2.perception.reader import CropReader

        found.append(CropReader(vision_model(options.vision, "perceiver.read_crops"), options.vision.longest))
    return tuple(found)
