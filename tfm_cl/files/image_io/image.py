"""An image with its extra channels, as it is written and read."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError

Metadata = str | int | float | NDArray[np.float64]

_RGBA = 4
_VECTOR = 3


@dataclass(frozen=True, kw_only=True)
class Image:
    """A picture, its AOVs, and its position in the full frame.

    Raises
    ------
    ImageError
        If arrays have other shapes, the crop does not fit them, or values are NaN or infinite (the message
        says where).
    """

    rgba: NDArray[np.float32]
    """[H, W, 4], row 0 on top; scene-linear, Rec. 709 primaries, premultiplied."""
    aovs: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """AOVs by name, [H, W] or [H, W, 3]."""
    display_window: tuple[int, int] | None = None
    """(width, height) of the full frame, pixels; None: this is the full frame."""
    crop: tuple[int, int, int, int] | None = None
    """(x0, y0, x1, y1): the pixels of the full frame in these arrays, x1 and y1 excluded; None: all."""
    metadata: dict[str, Metadata] = field(default_factory=dict)
    """Header attributes. A 4×4 matrix acts on column vectors; its name says what it does, like
    ``worldToCamera``."""
    foreground: NDArray[np.float32] | None = None
    """``rgba`` without a background, which a PNG with alpha shows; None: there is none."""

    def __post_init__(self) -> None:
        if self.rgba.ndim != _VECTOR or self.rgba.shape[2] != _RGBA or self.rgba.size == 0:
            raise ImageError(f"an image is [height, width, 4] and not empty; got the shape {self.rgba.shape}")
        check_finite(self.rgba, "the image")
        if self.foreground is not None:
            if self.foreground.shape != self.rgba.shape:
                raise ImageError(
                    f"the foreground is as large as the image, {self.rgba.shape}; got {self.foreground.shape}"
                )
            check_finite(self.foreground, "the foreground")
        height, width = self.rgba.shape[:2]
        for name, aov in self.aovs.items():
            if aov.shape not in {(height, width), (height, width, _VECTOR)}:
                raise ImageError(
                    f"AOV '{name}' is [{height}, {width}] or [{height}, {width}, 3]; got {aov.shape}"
                )
            check_finite(aov, f"AOV '{name}'")
        x0, y0, x1, y1 = self.data_window
        full_width, full_height = self.frame_size
        inside = min(x0, y0) >= 0 and x1 <= full_width and y1 <= full_height
        if (x1 - x0, y1 - y0) != (width, height) or not inside:
            raise ImageError(
                f"the crop {x0},{y0},{x1},{y1} does not fit {width}×{height} pixels of a frame of "
                f"{full_width}×{full_height}"
            )

    @property
    def frame_size(self) -> tuple[int, int]:
        """(width, height) of the full frame, pixels."""
        return self.display_window or (self.rgba.shape[1], self.rgba.shape[0])

    @property
    def data_window(self) -> tuple[int, int, int, int]:
        """(x0, y0, x1, y1) of these pixels in the full frame, x1 and y1 excluded."""
        return self.crop or (0, 0, self.rgba.shape[1], self.rgba.shape[0])


Window = tuple[int, int, int, int]
"""(x0, y0, x1, y1), pixels, x1 and y1 excluded."""


@dataclass(frozen=True)
class Picture:
    """Colours that were read, and their position in the full frame."""

    pixels: NDArray[np.float32]
    """[H, W, 3], or [H, W, 4] with an alpha channel."""
    window: Window | None = None
    """Pixels of the full frame that these are (EXR's data window); None if the file does not say."""
    frame: Window | None = None
    """The full frame (EXR's display window); None if the file does not say."""

    def part(self, window: Window) -> NDArray[np.float32]:
        """Return the pixels of a window of the frame, which must be within these."""
        if self.window is None:
            raise ValueError("these pixels have no place in a frame")
        left, top = self.window[:2]
        x0, y0, x1, y1 = window
        return self.pixels[y0 - top : y1 - top, x0 - left : x1 - left]


def check_finite(values: NDArray[np.float32], what: str) -> None:
    """Refuse NaN and infinity.

    Raises
    ------
    ImageError
        The message names the first such pixel.
    """
    if np.isfinite(values).all():
        return
    wrong = ~np.isfinite(values)
    first = tuple(int(i) for i in np.argwhere(wrong)[0])
    raise ImageError(
        f"{what} holds {np.count_nonzero(wrong)} values that are NaN or infinite, the first at "
        f"x={first[1]}, y={first[0]}; it is not written"
    )
