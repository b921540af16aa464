"""Finds the channels of an EXR that hold the picture: renderers name and arrange them in many ways."""

from dataclasses import dataclass

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io.image import Window

BEAUTY, COLOURS = {"beauty", "combined"}, {"rgb", "rgba"}
"""Lower-case words that the names of the picture's layer contain or begin with, in Arnold, Blender, Nuke …"""

_KINDS = {"red": "R", "green": "G", "blue": "B", "alpha": "A"} | {
    kind.lower(): kind for kind in ("R", "G", "B", "A", "Y", "RY", "BY")
}
PLAIN, CALLED_SO, PLAIN_OF_A_PART, OTHER = range(4)
"""Ranks of layers, best first: plain channels of the file or of a part whose name says so, and so on."""


@dataclass(frozen=True)
class Part:
    """The header of a part."""

    name: str
    channels: dict[str, bool]
    """For each channel, whether it is subsampled, that is, has fewer pixels than the picture."""
    window: Window
    """Data window: the pixels of the full frame that are stored."""
    frame: Window
    is_flat: bool = True
    """Whether every pixel has exactly one value per channel (the image is not deep)."""


@dataclass(frozen=True)
class Layer:
    """Channels of one part whose names have the same prefix."""

    part: int
    """Index of the part."""
    part_name: str
    """Name of the part; empty for the only part of a file."""
    name: str
    """The prefix without its dot; empty for plain R, G, B."""
    channels: dict[str, str]
    """Names of the channels by R, G, B, A, Y, RY or BY, as far as they exist."""
    subsampled: bool
    """Whether any of them has fewer pixels than the picture."""

    @property
    def rank(self) -> int:
        """Rank by name, from `PLAIN` to `OTHER`: lower is more likely to be the picture."""
        if not self.name:
            return PLAIN if not self.part_name or _is_beauty(self.part_name) else PLAIN_OF_A_PART
        return CALLED_SO if _is_beauty(self.name) else OTHER

    @property
    def colours(self) -> list[str]:
        """Channels of red, green and blue, and of alpha if there is one; luminance alone means grey."""
        rgb = [self.channels[name] for name in "RGB" if name in self.channels]
        grey = [self.channels["Y"]] * 3 if "Y" in self.channels else []
        colours = rgb if len(rgb) == len("RGB") else grey
        alpha = [name for kind, name in self.channels.items() if kind == "A"]
        return colours + alpha if colours else []

    def __str__(self) -> str:
        """Return the names of part and layer."""
        return ".".join(filter(None, (self.part_name, self.name)))


def _is_beauty(name: str) -> bool:
    """Tell whether a name denotes the picture, like ``ViewLayer.Combined`` and ``rgba.left``."""
    words = name.lower().split(".")
    return not BEAUTY.isdisjoint(words) or words[0] in COLOURS


def beauty(parts: list[Part]) -> Layer:
    """Find the picture among the channels of the parts of a file.

    It is the plain R, G, B (or Y) of the only part or of a part whose name denotes the picture; else the
    first layer whose name does; else the plain channels of the only part that has some.

    Raises
    ------
    ImageError
        If there is none, several without a telling name, luminance with chroma, or subsampled channels. The
        message does not name the file.
    """
    layers = [layer for part in range(len(parts)) for layer in _layers(parts, part)]
    pictures = sorted((layer for layer in layers if layer.colours), key=lambda layer: layer.rank)
    if not pictures or pictures[0].rank == OTHER:
        names = sorted(name for part in parts for name in part.channels)
        found = {name for layer in layers if not layer.name for name in layer.channels}
        missing = " ".join(name for name in "RGB" if name not in found)
        raise ImageError(f"has no channel {missing}; it has {' '.join(names)}")
    chosen = pictures[0]
    names = [str(layer) for layer in pictures if layer.rank == PLAIN_OF_A_PART]
    if chosen.rank == PLAIN_OF_A_PART and len(names) > 1:
        raise ImageError(f"none of its parts is called beauty, combined or rgba: {', '.join(names)}")
    if chosen.channels.get("Y") in chosen.colours and {"RY", "BY"} & set(chosen.channels):
        raise ImageError("holds luminance and chroma (Y RY BY), not colours; save it as plain RGB")
    if chosen.subsampled:
        raise ImageError("its channels are of different sizes (subsampled); save it as plain RGB")
    return chosen


def _layers(parts: list[Part], number: int) -> list[Layer]:
    """Group the channels of a part by the prefixes of their names."""
    part_name = parts[number].name if len(parts) > 1 else ""
    channels: dict[str, dict[str, str]] = {}
    subsampled = set()
    for channel, is_subsampled in parts[number].channels.items():
        name, _, end = channel.rpartition(".")
        kind = _KINDS.get(end.lower())
        if kind is not None:
            channels.setdefault(name, {}).setdefault(kind, channel)
            if is_subsampled:
                subsampled.add(name)
    return [
        Layer(number, part_name, name, of_layer, name in subsampled) for name, of_layer in channels.items()
    ]
