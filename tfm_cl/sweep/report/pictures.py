"""The images of a sweep and their errors, as small PNGs."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from tfm_cl.files.image_io.inline import png_of
from tfm_cl.metrics import REC709, display_rgb, lit_mask, white_of
from tfm_cl.sweep.rows import kept_image

if TYPE_CHECKING:
    from tfm_cl.sweep.report.groups import Group

SIDES = (640, 448, 320)
"""Longest side of a picture in pixels; a smaller value is used if pictures take too many bytes."""
COMPRESSION = 4
"""PNG compression level, 1 to 9: beyond this one, files get smaller by a twentieth and take twice as long."""


@dataclass(frozen=True)
class Pictures:
    """PNGs in base64, by name.

    ``KEY`` is an image (of a row or a reference), ``KEY-REFERENCEKEY`` the error of one against the other:
    the signed difference d of display luma as the grey value 128 + 127 sign(d) √|d|, which is precise for
    small d. Differences add up: a row's error against the converged reference is its error against the dual
    march plus the error of the dual march against the converged reference.
    """

    encoded: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    """Keys of rows whose image is missing from the folder or damaged."""
    left_out: list[str] = field(default_factory=list)
    """Keys of rows for whose pictures there was no room."""


def pictures(groups: list[Group], out: Path, room: int) -> Pictures:
    """Encode references first, then the rows that are best at equal bytes, then the others.

    Parameters
    ----------
    groups
        All groups that the report shows.
    out
        The sweep's folder.
    room
        Characters that all PNGs together may take. To fit, pictures first get smaller, then fewer.
    """
    found = Pictures()
    for side in SIDES:
        found = _encode(groups, out, room, side, whole=side != SIDES[-1])
        if not found.left_out:
            break
    return found


def _encode(groups: list[Group], out: Path, room: int, side: int, *, whole: bool) -> Pictures:
    """Encode at one size; if all pictures are required, stop at the first for which there is no room."""
    found = Pictures()
    views = [_View.of(group, out, side) for group in groups]
    for view in views:
        for encoded in view.references():
            if _size(encoded) <= room:
                found.encoded.update(encoded)
                room -= _size(encoded)
    ranked = [(group, view, row) for group, view in zip(groups, views, strict=True) for row in group.rows]
    ranked.sort(key=lambda item: item[2].key not in item[0].budgets)  # stable: otherwise in their order
    for _, view, row in ranked:
        image = kept_image(out, row.key, (row.width, row.height))
        if image is None:
            found.missing.append(row.key)
            continue
        encoded = view.row(row.key, image)
        if _size(encoded) <= room:
            found.encoded.update(encoded)
            room -= _size(encoded)
        else:
            found.left_out.append(row.key)
            if whole:
                break
    return found


def _size(encoded: dict[str, str]) -> int:
    return sum(map(len, encoded.values()))


@dataclass(frozen=True)
class _View:
    """The part of the frame that is shown of a group, where the reference is lit, and its white."""

    window: tuple[slice, slice]
    """Rows and columns of the frame that are shown."""
    white: float
    side: int
    """Longest side of a picture, pixels."""
    truths: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    """Display images [h, w, 3] of the existing references by key: the dual march of the same steps, then the
    converged one."""

    @classmethod
    def of(cls, group: Group, out: Path, side: int) -> _View:
        row = group.first
        keys = [row.reference, *([group.converged] if group.converged else [])]
        found = {key: kept_image(out, key, (row.width, row.height)) for key in keys}
        images = {key: image for key, image in found.items() if image is not None}
        if not images:
            return cls((slice(None), slice(None)), 1.0, side)
        base = next(iter(images.values()))
        lit = lit_mask(base)
        view = cls((_occupied(lit.sum(axis=1)), _occupied(lit.sum(axis=0))), white_of(base), side)
        view.truths.update({key: view.shown(image) for key, image in images.items()})
        return view

    def shown(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the display image [h, w, 3], 0 to 1, of an image [H, W, 4]."""
        display = display_rgb(image[self.window], self.white).astype(np.float32)
        # Average whole blocks of pixels, so that nothing is sharpened or shifted.
        factor = -(-max(display.shape[:2]) // self.side)
        if factor == 1:
            return display
        channels = (
            PIL.Image.fromarray(np.ascontiguousarray(display[..., c])).reduce(factor) for c in range(3)
        )
        return np.dstack([np.asarray(channel) for channel in channels])

    def references(self) -> list[dict[str, str]]:
        """Return pictures of the references, and the error of the first against the second."""
        found = [{key: _picture(shown)} for key, shown in self.truths.items()]
        if len(self.truths) > 1:
            (dual, shown), (converged, truth) = self.truths.items()
            found.append({f"{dual}-{converged}": _error(shown, truth)})
        return found

    def row(self, key: str, image: NDArray[np.float32]) -> dict[str, str]:
        """Return pictures of a row: its image [H, W, 4], and its error against the first reference."""
        shown = self.shown(image)
        found = {key: _picture(shown)}
        for reference, truth in list(self.truths.items())[:1]:
            found[f"{key}-{reference}"] = _error(shown, truth)
        return found


def _occupied(counts: NDArray[np.int_]) -> slice:
    """Range of the counts above 0, with a margin; the whole range if none is."""
    occupied = np.flatnonzero(counts)
    if occupied.size == 0:
        return slice(0, counts.size)
    margin = 2 + (occupied[-1] - occupied[0]) // 12
    return slice(max(0, int(occupied[0] - margin)), min(counts.size, int(occupied[-1] + margin + 1)))


def _picture(shown: NDArray[np.float32]) -> str:
    return _png(np.round(255 * shown))


def _error(shown: NDArray[np.float32], truth: NDArray[np.float32]) -> str:
    difference = (shown - truth) @ REC709
    return _png(np.round(128 + 127 * np.sign(difference) * np.sqrt(np.abs(difference))))


def _png(values: NDArray[np.floating[Any]]) -> str:
    png = png_of(values.astype(np.uint8), level=COMPRESSION, is_srgb=False)
    return base64.b64encode(png).decode("ascii")
