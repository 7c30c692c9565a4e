"""Options of every perceiver that names objects: ``perceiver.gallery=FOLDER perceiver.vision.base_url=...``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.language.options import EndpointOptions

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2.perception.labels import Labeller


@dataclass(kw_only=True)
class VisionOptions(EndpointOptions):
    """A vision-language model at its own OpenAI-compatible address: planners may ask another. "" is none.

    ``scale`` is the range of its coordinates: 1, 1000 for Qwen3-VL or Gemini.
    """

    base_url: str = ""
    scale: float = 1000.0
    longest: int = 1024


@dataclass(kw_only=True)
class NamingOptions:
    """Sources of names besides colour and shape.

    ``gallery``: a folder of scans (.obj, .glb, .ply; with joints .urdf) of known objects, "" for none. ``read_text``:
    whether text on objects that the gallery does not know is read, in pictures of some 700 pixels and more.
    ``read_crops``: whether the model at ``vision`` reads crops of objects that the gallery does not know.
    """

    gallery: str = ""
    read_text: bool = False
    read_crops: bool = False
    vision: VisionOptions = field(default_factory=VisionOptions)


def vision_model(options: VisionOptions, wanted_by: str) -> LanguageModel:
    """The vision-language model; raises :class:`ConfigurationError` if none is given."""
    from gvla2.language.endpoint import Endpoint

    if not options.base_url:
        raise ConfigurationError(
            f"{wanted_by} needs a vision-language model: perceiver.vision.base_url=http://127.0.0.1:8000/v1."
        )
    return Endpoint(options)


def labellers(options: NamingOptions) -> tuple[Labeller, ...]:
    """The configured labellers, the most reliable first."""
    found: list[Labeller] = []
    if options.gallery:
        from gvla2.perception.gallery import Gallery

        found.append(Gallery.read(options.gallery))
    if options.read_text:
        from gvla2.perception.text import TextReader

        found.append(TextReader())
    if options.read_crops:
        from gvla2.perception.labels import CropReader

        found.append(CropReader(vision_model(options.vision, "perceiver.read_crops"), options.vision.longest))
    return tuple(found)
