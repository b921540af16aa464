"""The quality-versus-coefficients sweep: maps of n coefficients against the dual march of the same steps.

A sweep fills a folder::

    sweep.jsonl, sweep.csv        one row for each scene, coefficient count and density weighting
    images/KEY.npy                each rendered image; the reference's seconds beside it, KEY.json
    sweep.png, contact_sheet.png  quality against coefficients; the images and their errors
    sweep.md                      the rows as tables

Rows are appended as they are made, so a sweep that is interrupted goes on where it stopped: a row whose key
(content of the scene, settings, device, version of tfm_cl) is there already is not made again.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, Field, TypeAdapter, ValidationError

from tfm_cl import image_io
from tfm_cl._version import __version__
from tfm_cl.errors import ImageError, InputError, SceneError
from tfm_cl.files import replacing, write_text
from tfm_cl.metrics import compare
from tfm_cl.scene import Scene
from tfm_cl.scene_file import SceneFile
from tfm_cl.volume import Volume

if TYPE_CHECKING:
    from tfm_cl.passes.launch import Progress
    from tfm_cl.renderer import Renderer

Weighting = float | Literal["auto"]
"""α of eq. 19."""

Overrides = Iterable[tuple[str, Any]] | Callable[[Scene], Scene]

Metric = Annotated[float, BeforeValidator(lambda value: float("inf") if value is None else value)]
"""JSON has no infinity: it is written as null."""

Count = Annotated[int, Field(ge=1, lt=1 << 31)]
Seconds = Annotated[float, Field(ge=0)]
Key = Annotated[str, Field(pattern="^[0-9a-f]{24}$")]
"""From `content_hash`; it names files."""


@dataclass(frozen=True, kw_only=True)
class SweepRow:
    """One scene rendered with one map setting, against its reference."""

    volume: str
    """The input's name."""
    coeffs: Count
    density_weighting: Weighting
    basis: str
    storage: str
    map_res: Count
    """Texels along each side of a map."""
    map_steps: Count
    """Steps along a light ray, of the maps and of the reference."""
    view_steps: Count
    """Steps along a camera ray, of both."""
    width: Count
    height: Count
    ssim: Metric
    psnr: Metric
    """dB; infinite when identical, JSON null."""
    rmse: Metric
    """Relative to the reference's mean."""
    lit_ssim: Metric
    lit_psnr: Metric
    lit_rmse: Metric
    seconds_light_pass: Seconds
    """Device time after compilation, as the next two."""
    seconds_view_pass: Seconds
    seconds_reference: Seconds
    """Dual march."""
    map_bytes: Annotated[int, Field(ge=0)]
    """Of all lights' maps."""
    device: str
    version: str
    """Of tfm_cl."""
    reference: Key
    """Key of the reference: all that the dual march depends on."""
    key: Key
    """Key of the row: the reference and the map's settings."""


_ROW = TypeAdapter(SweepRow)
_COLUMNS = [field.name for field in dataclasses.fields(SweepRow)]


def run(
    inputs: Sequence[Path],
    out: Path,
    *,
    coeffs: Sequence[int] = (2, 4, 8, 16),
    density_weightings: Sequence[Weighting] = (1.0, 10.0),
    renderer: Renderer | None = None,
    device: str | None = None,
    overrides: Overrides | None = None,
    progress: Progress | None = None,
) -> list[SweepRow]:
    """Sweep scenes over coefficients and density weightings, and write the report.

    Parameters
    ----------
    inputs
        Scene files or volumes.
    out
        Folder of the results, made if missing. One sweep at a time may write to it; another sweep, or one
        with other settings, may add to it later.
    coeffs, density_weightings
        Numbers of coefficients and values of α (1 or more, or ``"auto"``); every pair is rendered.
    renderer, device
        A renderer to use, or part of the name of the device to make one on.
    overrides
        Settings for every scene: pairs of a scene file's key and its value, as ``("camera.res", [320, 180])``
        (known before camera and light are placed), or a function of the scene that was read.
    progress
        Called as ``progress(stage, fraction)`` with the fraction of the whole sweep.

    Returns
    -------
    list of SweepRow
        Every row asked for, made now or earlier: by input, then α, then coefficients.

    Raises
    ------
    InputError
        Nothing to sweep, an input that cannot be read, a reference that shows nothing, a folder that
        cannot be written or holds rows of another kind.
    DeviceError
        From the renderer. Rows made before any error stay.
    """
    if not (inputs and coeffs and density_weightings):
        raise InputError("a sweep needs at least one input, one number of coefficients and one α")
    from tfm_cl import sweep_report  # noqa: PLC0415 - it builds on this module

    if renderer is None:
        from tfm_cl.renderer import Renderer  # noqa: PLC0415 - a caller's own renderer needs no OpenCL

        owned: Any = Renderer(device)
    else:
        owned = nullcontext(renderer)
    settings = [(alpha, n) for alpha in dict.fromkeys(density_weightings) for n in dict.fromkeys(coeffs)]
    inputs = list(dict.fromkeys(inputs))
    overrides = overrides if callable(overrides) else list(overrides or ())
    steps = _Steps(progress, len(inputs) * (1 + len(settings)))
    rows: list[SweepRow] = []
    with owned as used:
        sweep = _Sweep(used, SweepFolder(out), steps)
        for path, name in zip(inputs, _names(inputs), strict=True):
            rows += sweep.scene(_load(path, overrides), name, settings)
    sweep_report.write(out)
    return rows


def _load(path: Path, overrides: Overrides) -> Scene:
    if callable(overrides):
        return overrides(Scene.load(path))
    return SceneFile.read(path, overrides).scene()


@dataclass(frozen=True)
class _Sweep:
    """What stays the same from scene to scene."""

    renderer: Renderer
    folder: SweepFolder
    steps: _Steps

    def scene(self, scene: Scene, name: str, settings: list[tuple[Weighting, int]]) -> list[SweepRow]:
        scene = scene.resolved()
        # All settings are checked before the first, possibly long, rendering.
        variants = [
            scene.replace(map=scene.map.replace(coeffs=n, density_weighting=alpha)) for alpha, n in settings
        ]
        reference_key = _reference_key(scene, self.renderer.device_name)
        keys = [content_hash(reference_key, variant.map) for variant in variants]
        if all(key in self.folder.rows for key in keys):
            self.steps.skip(1 + len(keys))
            return [self.folder.rows[key] for key in keys]
        reference, seconds = self._reference(scene, name, reference_key)
        for variant, key in zip(variants, keys, strict=True):
            if key in self.folder.rows:
                self.steps.skip()
                continue
            row = self._row(variant, name, reference, seconds, reference=reference_key, key=key)
            self.folder.append(row)
        return [self.folder.rows[key] for key in keys]

    def _reference(self, scene: Scene, name: str, key: str) -> tuple[NDArray[np.float32], float]:
        found = self.folder.reference(key, scene.camera.res)
        if found is not None:
            self.steps.skip()
            return found
        with self.steps.step(f"{name}: reference") as progress:
            result = self.renderer.render(scene, method="dual", progress=progress)
        seconds = result.stats.seconds["light_pass"] + result.stats.seconds["view_pass"]
        self.folder.save_image(key, result.image)
        self.folder.save_seconds(key, seconds)
        return result.image, seconds

    def _row(
        self,
        scene: Scene,
        name: str,
        reference_image: NDArray[np.float32],
        reference_seconds: float,
        **keys: str,
    ) -> SweepRow:
        with self.steps.step(f"{name}: n={scene.map.coeffs} α={scene.map.density_weighting}") as progress:
            result = self.renderer.render(scene, method="tfm", progress=progress)
        found = compare(result.image, reference_image)
        if found.lit is None:
            raise SceneError(
                f"{name}: the reference shows nothing (alpha ≤ 0.001 everywhere), so there is no quality to "
                "measure; check camera, density_scale and light"
            )
        self.folder.save_image(keys["key"], result.image)
        width, height = scene.camera.res
        return SweepRow(
            volume=name,
            coeffs=scene.map.coeffs,
            density_weighting=scene.map.density_weighting,
            basis=scene.map.basis,
            storage=scene.map.storage,
            map_res=scene.map.res,
            map_steps=scene.map.steps,
            view_steps=scene.march.steps,
            width=width,
            height=height,
            ssim=found.ssim,
            psnr=found.psnr,
            rmse=found.rmse,
            lit_ssim=found.lit.ssim,
            lit_psnr=found.lit.psnr,
            lit_rmse=found.lit.rmse,
            seconds_light_pass=result.stats.seconds["light_pass"],
            seconds_view_pass=result.stats.seconds["view_pass"],
            seconds_reference=reference_seconds,
            map_bytes=result.stats.map_bytes,
            device=self.renderer.device_name,
            version=__version__,
            **keys,
        )


class SweepFolder:
    """The folder of a sweep; opening it repairs what an interruption left.

    Parameters
    ----------
    path
        Made if missing.

    Raises
    ------
    InputError
        When it cannot be read or written, or a line before the last is not a row of this version.
    """

    rows: dict[str, SweepRow]
    """By key, in the order in which they were made."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._jsonl, self._csv = path / "sweep.jsonl", path / "sweep.csv"
        self._images = path / "images"
        with _one_line_errors(self._images, "made"):
            self._images.mkdir(parents=True, exist_ok=True)
        rows = read_rows(path) if self._jsonl.exists() else []
        self.rows = {row.key: row for row in rows}
        # The table follows the JSON lines; a torn last line of either is gone after this.
        with replacing(self._jsonl) as temporary:
            temporary.write_bytes(b"".join(map(_json_line, self.rows.values())))
        with replacing(self._csv) as temporary:
            header = (",".join(_COLUMNS) + "\n").encode()
            temporary.write_bytes(header + b"".join(map(_csv_line, self.rows.values())))

    def append(self, row: SweepRow) -> None:
        """Add a row to both files."""
        for path, line in ((self._csv, _csv_line(row)), (self._jsonl, _json_line(row))):
            with _one_line_errors(path, "written"), path.open("ab") as file:
                file.write(line)
        self.rows[row.key] = row

    def save_image(self, key: str, image: NDArray[np.float32]) -> None:
        """Keep an image [H, W, 4]."""
        image_io.save(self._images / f"{key}.npy", image_io.Image(rgba=image))

    def save_seconds(self, key: str, seconds: float) -> None:
        """Keep a reference's device time."""
        write_text(self._images / f"{key}.json", json.dumps({"seconds": seconds}))

    def reference(self, key: str, res: tuple[int, int]) -> tuple[NDArray[np.float32], float] | None:
        """Return a reference and its seconds, or None if either is missing or damaged."""
        image = kept_image(self._path, key, res)
        try:
            seconds = float(json.loads((self._images / f"{key}.json").read_bytes())["seconds"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return None if image is None else (image, seconds)


def read_rows(out: Path) -> list[SweepRow]:
    """Read the rows of a sweep's folder; a last line that is not whole is left out.

    Raises
    ------
    InputError
        No such file, or another line than the last is not a row of this version.
    """
    path = out / "sweep.jsonl"
    with _one_line_errors(path, "read"):
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


def kept_image(out: Path, key: str, res: tuple[int, int]) -> NDArray[np.float32] | None:
    """Read an image of ``res`` (width, height) that a sweep kept, or None if it is missing or damaged.

    Parameters
    ----------
    out
        The sweep's folder.
    key
        Of a row, or of its reference.

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


def content_hash(*values: Any) -> str:
    """Hash what values hold: 24 hexadecimal digits, the same in every process.

    Raises
    ------
    SceneError
        For an object whose content it does not know how to read.
    """
    digest = hashlib.sha256()
    _feed(digest, values)
    return digest.hexdigest()[:24]


def _feed(digest: hashlib._Hash, value: Any) -> None:
    digest.update(f"\0{type(value).__qualname__} ".encode())
    if value is None or isinstance(value, bool | int | float | str):
        digest.update(repr(value).encode())
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biufc":
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, Volume):
        # As stored: the dense array of a sparse volume may be far larger than memory.
        stored = value._voxels.stored  # noqa: SLF001 - asking for either form may make it
        _feed(digest, (stored, value.world_from_index, value.density_scale))
    elif isinstance(value, BaseModel):
        _feed(digest, {name: getattr(value, name) for name in type(value).model_fields})
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        _feed(digest, {field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    elif isinstance(value, dict | list | tuple):
        digest.update(str(len(value)).encode())
        for item in value.items() if isinstance(value, dict) else value:
            _feed(digest, item)
    elif isinstance(value, Path) and value.is_file():
        digest.update(value.read_bytes())
    else:
        raise SceneError(f"a sweep cannot tell whether a {type(value).__qualname__} of the scene has changed")


def _reference_key(scene: Scene, device: str) -> str:
    """Hash all that the dual march depends on: of the map's settings, only the steps."""
    content = {field.name: getattr(scene, field.name) for field in dataclasses.fields(scene)}
    content["map"] = scene.map.steps
    content["march"] = scene.march.replace(method="dual")
    return content_hash(content, device, __version__)


def _names(inputs: Sequence[Path]) -> list[str]:
    """Name inputs by their stem where that tells them apart, else by their path."""
    stems = [path.stem for path in inputs]
    return [
        stem if stems.count(stem) == 1 else path.as_posix() for path, stem in zip(inputs, stems, strict=True)
    ]


def _json_line(row: SweepRow) -> bytes:
    return _ROW.dump_json(row) + b"\n"


def _csv_line(row: SweepRow) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(dataclasses.astuple(row))
    return text.getvalue().encode()


@contextmanager
def _one_line_errors(path: Path, verb: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be {verb} ({error.strerror or error})") from error


class _Steps:
    """Progress over renderings of equal weight; never goes back."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self._progress, self._total = progress, total
        self._done = 0
        self._reached = 0.0

    @contextmanager
    def step(self, label: str) -> Iterator[Progress]:
        """Report one rendering; yields the callback to hand to it."""
        self._report(label, 0.0)
        yield lambda stage, fraction: self._report(f"{label}: {stage}", fraction)
        self.skip()
        self._report(label, 0.0)

    def skip(self, count: int = 1) -> None:
        """Count renderings that are done."""
        self._done += count

    def _report(self, stage: str, fraction: float) -> None:
        if self._progress is not None:
            self._reached = max(self._reached, min(1.0, (self._done + fraction) / self._total))
            self._progress(stage, self._reached)
