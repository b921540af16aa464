"""An image with its extra channels, as it is written and read."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import ImageError

Metadata = str | int | float | NDArray[np.float64]

_RGBA = 4
_VECTOR = 3

OPAQUE = 1 - 2.0**-24
"""What counts as opaque where logarithms are taken: less than float32 sees is left."""


@dataclass(frozen=True, eq=False)
class DeepSamples:
    """What lies along the ray of each pixel: samples of all, one after the other, row by row from the top.

    As "Interpreting OpenEXR Deep Pixels" (openexr.com) defines them: inside a sample of opacity α from Z to
    ZBack the transmittance at depth z is (1 - α)^((z - Z)/(ZBack - Z)), and its colour, premultiplied by its
    own opacity alone, comes from where that is taken. Samples of a pixel are in order and do not overlap; a
    solid is one whose ZBack is its Z.

    Raises
    ------
    ImageError
        If arrays have other lengths than ``counts`` says.
    """

    counts: NDArray[np.int32]
    """[H, W], samples of each pixel."""
    z: NDArray[np.float32]
    """[n], where each begins, along the camera's viewing direction, world units."""
    z_back: NDArray[np.float32]
    """[n], where it ends."""
    alpha: NDArray[np.float32]
    """[n], its opacity, mean over the colours."""
    rgb: NDArray[np.float32] | None = None
    """[n, 3], radiance, scene-linear Rec. 709, premultiplied by ``alpha``; None if it was not asked for."""

    def __post_init__(self) -> None:
        count = int(self.counts.sum(dtype=np.int64))
        shapes = [array.shape for array in (self.z, self.z_back, self.alpha)]
        if shapes != [(count,)] * 3 or (self.rgb is not None and self.rgb.shape != (count, 3)):
            raise ImageError(f"deep samples of {count} numbers are expected; got the shapes {shapes}")

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """[H·W], number of samples up to the end of each pixel."""
        return np.cumsum(self.counts.ravel(), dtype=np.int64)

    @cached_property
    def before(self) -> NDArray[np.float64]:
        """[n], transmittance of what the pixel has before each sample."""
        depth = -np.log1p(-np.minimum(self.alpha.astype(np.float64), OPAQUE))
        total = np.concatenate([[0.0], np.cumsum(depth)])
        starts = np.repeat(total[self.ends - self.counts.ravel()], self.counts.ravel())
        found: NDArray[np.float64] = np.exp(starts - total[:-1])
        return found

    def flattened(self) -> NDArray[np.float32]:
        """Composite each pixel's samples: [H, W, 4], or [H, W, 1] without colours."""
        of_samples = self.alpha[:, None] if self.rgb is None else np.column_stack([self.rgb, self.alpha])
        added = np.zeros((len(self.alpha) + 1, of_samples.shape[1]))
        np.cumsum(of_samples * self.before[:, None], axis=0, out=added[1:])
        flat = added[self.ends] - added[self.ends - self.counts.ravel()]
        image: NDArray[np.float32] = flat.reshape(*self.counts.shape, -1).astype(np.float32)
        return image

    def check_finite(self) -> None:
        """Refuse NaN and infinity.

        Raises
        ------
        ImageError
            The message says how many there are.
        """
        arrays = [self.z, self.z_back, self.alpha, *([] if self.rgb is None else [self.rgb])]
        wrong = sum(int(np.count_nonzero(~np.isfinite(array))) for array in arrays)
        if wrong:
            raise ImageError(f"the deep samples hold {wrong} values that are NaN or infinite; not written")

    def __repr__(self) -> str:
        """Return how many there are."""
        height, width = self.counts.shape
        return f"DeepSamples({len(self.alpha):,} samples of {width}×{height} pixels)"


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
    deep: DeepSamples | None = None
    """What deep formats write of these pixels; None: there is none."""

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
        if self.deep is not None:
            if self.deep.counts.shape != (height, width):
                raise ImageError(f"deep samples are of {width}×{height} pixels; got {self.deep!r}")
            self.deep.check_finite()
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
