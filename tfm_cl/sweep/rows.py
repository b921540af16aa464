"""The rows of a sweep and the folder that keeps them."""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from tfm_cl.errors import ImageError, InputError
from tfm_cl.files import image_io
from tfm_cl.files.locks import lock
from tfm_cl.files.paths import replacing, write_text

Weighting = float | Literal["auto"]
"""Density weighting: α of eq. 19, or ``auto``."""

Metric = Annotated[float, BeforeValidator(lambda value: float("inf") if value is None else value)]
"""A value that may be infinite; JSON has no infinity, so it is written as null."""

Count = Annotated[int, Field(ge=1, lt=1 << 31)]
Seconds = Annotated[float, Field(ge=0)]
Key = Annotated[str, Field(pattern="^[0-9a-f]{24}$")]
"""A key from `content_hash`; keys are used in file names."""

CONVERGED = (
    "converged_ssim",
    "converged_psnr",
    "converged_rmse",
    "converged_lit_ssim",
    "converged_lit_psnr",
    "converged_lit_rmse",
)
"""Fields of a row that are set if ``converged`` is."""


@dataclass(frozen=True, kw_only=True)
class SweepRow:
    """One scene rendered with one map setting, compared with its reference."""

    volume: str
    """Name of the input."""
    coeffs: Count
    density_weighting: Weighting
    """Density weighting as requested; ``auto`` if the map's target is not the transmittance."""
    basis: str
    """As resolved, never ``auto``; the same holds for the next four."""
    target: str
    range: str
    fit: str
    lookup: str
    storage: str
    map_res: Count
    """Texels along each side of a map."""
    map_steps: Count
    """Steps along a light ray, for the maps and the reference."""
    view_steps: Count
    """Steps along a camera ray, for both."""
    width: Count
    height: Count
    ssim: Metric
    psnr: Metric
    """PSNR in dB; infinite if identical, in JSON null."""
    rmse: Metric
    """RMSE relative to the reference's mean."""
    lit_ssim: Metric
    lit_psnr: Metric
    lit_rmse: Metric
    converged_ssim: float | None = None
    """Compared with the converged dual march, like the next five; None if there is none."""
    converged_psnr: float | None = None
    """dB; infinite if identical, in JSON null. So is a value that was not measured: ``converged`` tells."""
    converged_rmse: float | None = None
    converged_lit_ssim: float | None = None
    converged_lit_psnr: float | None = None
    converged_lit_rmse: float | None = None
    flip: float | None = None
    """Mean HDR-FLIP against the reference, 0 to 1; None without the package flip-evaluator."""
    t_error: Metric
    """Relative RMS error of the transmittance along the map's own light rays, weighted by density; mean over
    lights."""
    seconds_light_pass: Seconds
    """Device time without compilation, like the next two."""
    seconds_view_pass: Seconds
    seconds_reference: Seconds
    """Device time of the dual march."""
    map_bytes: Annotated[int, Field(ge=0)]
    """Bytes of the maps of all lights."""
    bytes_per_texel: Annotated[float, Field(ge=0)]
    """Bytes per texel of one map, including its range; mean over lights."""
    device: str
    version: str
    """Version of tfm_cl."""
    reference: Key
    """Key of the reference: a hash of everything that the dual march depends on."""
    converged: Key | None = None
    """Key of the converged dual march, or None."""
    key: Key
    """Key of the row: a hash of the reference and the map's settings."""
    stands_for: tuple[Count, ...] = ()
    """Requested numbers of coefficients that the basis does not support; ``coeffs`` is the nearest one."""

    def __post_init__(self) -> None:
        # A null in JSON is infinite if there was a reference to compare with.
        for name in CONVERGED if self.converged else ():
            if getattr(self, name) is None:
                object.__setattr__(self, name, float("inf"))


_ROW = TypeAdapter(SweepRow)
_COLUMNS = [field.name for field in dataclasses.fields(SweepRow)]

BUDGETS = (16, 24, 40)
"""Budgets for comparing bases at equal size, bytes per texel."""


def equal_bytes(
    rows: Iterable[SweepRow], budgets: Sequence[float] = BUDGETS
) -> dict[str, dict[float, dict[str, SweepRow]]]:
    """Choose the best row of every basis within budgets of bytes per texel.

    Bases with different storage types, ranges and numbers of coefficients can only be compared in this way:
    what counts is the size of a texel.

    Parameters
    ----------
    rows
        Rows of any number of volumes. The best is chosen among the other settings: coefficients, α, range,
        fit, storage and map size.
    budgets
        Largest `SweepRow.bytes_per_texel`, bytes.

    Returns
    -------
    dict
        ``[volume][budget][basis]``: the row with the highest ``lit_psnr``, and of equal ones the smallest.
        Volumes and bases are in the order of the rows. Every volume has every budget; a basis without a row
        that is small enough is missing there.
    """
    found: dict[str, dict[float, dict[str, SweepRow]]] = {}
    rows = list(rows)
    for row in rows:
        of_volume = found.setdefault(row.volume, {budget: {} for budget in budgets})
        for budget, best in of_volume.items():
            other = best.get(row.basis)
            if row.bytes_per_texel <= budget and (other is None or _rank(row) > _rank(other)):
                best[row.basis] = row
    order = list(dict.fromkeys(row.basis for row in rows))
    return {
        volume: {
            budget: {basis: best[basis] for basis in order if basis in best}
            for budget, best in of_volume.items()
        }
        for volume, of_volume in found.items()
    }


def in_place_of(counts: dict[int, int]) -> str:
    """Say which numbers of coefficients replace which requested ones, the keys."""
    return ", ".join(f"{own} in place of {asked}" for asked, own in sorted(counts.items()))


def _rank(row: SweepRow) -> tuple[float, float]:
    return row.lit_psnr, -row.bytes_per_texel


class SweepFolder:
    """The folder of a sweep, for one sweep at a time; opening it repairs the effects of an interruption.

    Parameters
    ----------
    path
        The folder; created if missing.

    Raises
    ------
    InputError
        If another sweep has it open, it cannot be read or written, or a line before the last is not a row of
        this version.
    """

    rows: dict[str, SweepRow]
    """Rows by key, in the order in which they were made."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._jsonl, self._csv = path / "sweep.jsonl", path / "sweep.csv"
        self._images = path / "images"
        with one_line_errors(self._images, "made"):
            self._images.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(path)
        try:
            rows = read_rows(path) if self._jsonl.exists() else []
            self.rows = {row.key: row for row in rows}
            self._rewrite()
            self._tidy()
        except BaseException:
            self._lock.close()
            raise

    def close(self) -> None:
        """Release the folder and remove incomplete images; no process may still be writing."""
        self._tidy()
        self._lock.close()

    def _rewrite(self) -> None:
        # The table follows the JSON lines; this removes an incomplete last line of either.
        with replacing(self._jsonl) as temporary:
            temporary.write_bytes(b"".join(map(_json_line, self.rows.values())))
        with replacing(self._csv) as temporary:
            header = (",".join(_COLUMNS) + "\n").encode()
            temporary.write_bytes(header + b"".join(map(_csv_line, self.rows.values())))

    def append(self, row: SweepRow) -> None:
        """Add a row to both files, or replace the one with the same key."""
        known = row.key in self.rows
        self.rows[row.key] = row
        if known:
            self._rewrite()
            return
        for path, line in ((self._csv, _csv_line(row)), (self._jsonl, _json_line(row))):
            with one_line_errors(path, "written"), path.open("ab") as file:
                file.write(line)

    def _tidy(self) -> None:
        """Remove incomplete images of terminated processes."""
        for path in self._images.glob(".*.tmp"):
            with contextlib.suppress(OSError):
                path.unlink()

    def has_march(self, key: str, res: tuple[int, int]) -> bool:
        """Tell whether a dual march and its seconds exist and are complete."""
        return kept_march(self._path, key, res) is not None


def keep_image(out: Path, key: str, image: NDArray[np.float32]) -> None:
    """Keep an image [H, W, 4] in a sweep's folder."""
    image_io.save(out / "images" / f"{key}.npy", image_io.Image(rgba=image))


def keep_march(out: Path, key: str, image: NDArray[np.float32], seconds: float) -> None:
    """Keep a dual march [H, W, 4] and its device time in a sweep's folder."""
    keep_image(out, key, image)
    write_text(out / "images" / f"{key}.json", json.dumps({"seconds": seconds}))


def kept_march(out: Path, key: str, res: tuple[int, int]) -> tuple[NDArray[np.float32], float] | None:
    """Return a dual march [H, W, 4] and its seconds, or None if either is missing or damaged."""
    try:
        seconds = float(json.loads((out / "images" / f"{key}.json").read_bytes())["seconds"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    image = kept_image(out, key, res)
    return None if image is None or not 0 <= seconds < float("inf") else (image, seconds)


def kept_image(out: Path, key: str, res: tuple[int, int]) -> NDArray[np.float32] | None:
    """Read an image of ``res`` (width, height) that a sweep kept, or None if it is missing or damaged.

    Parameters
    ----------
    out
        The sweep's folder.
    key
        Key of a row, or of its reference.

    Returns
    -------
    NDArray or None
        [H, W, 4], finite.
    """
    try:
        image = image_io.load_image(out / "images" / f"{key}.npy")
    except ImageError:
        return None
    return image if image.shape == (*res[::-1], 4) and np.isfinite(image).all() else None


def read_rows(out: Path) -> list[SweepRow]:
    """Read the rows of a sweep's folder; an incomplete last line is ignored.

    Raises
    ------
    InputError
        No such file, or another line than the last is not a row of this version.
    """
    path = out / "sweep.jsonl"
    with one_line_errors(path, "read"):
        lines = path.read_bytes().splitlines()
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(_ROW.validate_json(line))
        except ValidationError:
            if number < len(lines):
                raise InputError(
                    f"{path}, line {number}: not a row of this version's sweeps; "
                    "remove the line or choose another folder"
                ) from None
    return rows


def _locked(path: Path) -> BinaryIO:
    """Lock the folder: open a file that only one sweep may have open at a time."""
    name = path / ".lock"
    with one_line_errors(name, "written"):
        file = name.open("ab")
    if lock(file.fileno()):
        return file
    file.close()
    raise InputError(f"{path}: another sweep is writing there; wait for it to end, or choose another folder")


@contextmanager
def one_line_errors(path: Path, verb: str) -> Iterator[None]:
    """Convert an error of the system into an `InputError` that names the path."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be {verb} ({error.strerror or error})") from error


def _json_line(row: SweepRow) -> bytes:
    return _ROW.dump_json(row) + b"\n"


def _csv_line(row: SweepRow) -> bytes:
    text = io.StringIO()
    values = [
        " ".join(map(str, value)) if isinstance(value, tuple) else value for value in dataclasses.astuple(row)
    ]
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue().encode()
