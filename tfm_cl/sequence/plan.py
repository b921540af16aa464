"""What is decided once for a range, so that nothing jumps from frame to frame: every ``"auto"``, every place.

A few frames spread over the range are looked at. What was found is a set of scene-file keys and values that
win over the file in each frame, so that behind the scene file nothing knows of it; it is written beside the
frames, and read back by whoever makes others of them.
"""

from __future__ import annotations

import math
import time
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tfm_cl.errors import InputError, NoDeviceError
from tfm_cl.files.image_io.display import WHY_AUTOMATIC, automatic_exposure
from tfm_cl.files.paths import is_file, write_text
from tfm_cl.files.patterns import FilePattern
from tfm_cl.model import decided
from tfm_cl.plan import octaves, surroundings
from tfm_cl.plan.options import grids
from tfm_cl.plan.plan import GROUND, PLACED, Decision, Decisions, Plan, of_camera, plan, told_of
from tfm_cl.scene import looks, placement
from tfm_cl.scene.bodies.base import MarchedBody
from tfm_cl.scene.bodies.homogeneous import Homogeneous
from tfm_cl.scene.bodies.primitives import Primitives
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.optical_depth import why_density
from tfm_cl.scene.scene import Scene
from tfm_cl.scene.scene_file import Made
from tfm_cl.scene.scene_file_writer import to_toml
from tfm_cl.scene.solids.ground import GroundSolid
from tfm_cl.sequence.claims import Ledger
from tfm_cl.sequence.fingerprint import fingerprint, states
from tfm_cl.sequence.ranges import frames_of
from tfm_cl.sequence.shot import Shot

if TYPE_CHECKING:
    from tfm_cl.render.result import RenderResult
    from tfm_cl.scene.bodies.base import Body
    from tfm_cl.scene.scene_file import SceneFile
    from tfm_cl.sequence.renderer import Renderer

MOST_LOOKED_AT = 5
"""Frames of a range that decisions go by: the first, the last, and some between them."""
KEPT_VALUES = 1 << 28
"""Voxels and primitives of these frames that are kept at most; others are read twice."""
LARGEST = 1 << 24
"""Bytes of a plan's file."""
PILOT_WIDTH = 240
"""Pixels across the pictures that an exposure is chosen by."""
COUNTS = ("map.res", "map.steps", "march.steps")
"""Of which the most that any frame needs is taken."""
WEIGHTING, EXPOSURE, FUNCTIONS = "map.density_weighting", "image.exposure", "map.functions"
OF_FLAMES = {"temperature_scale": "for the hottest", "Le_scale": "for the deepest"}
"""Keys of [medium] that looks take from each file: the least serves all frames."""
OF_DENSEST = ("map.target", "map.fit", WEIGHTING)
"""What is as in the densest frame."""
NO_PLAN = (
    OSError,
    ArithmeticError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RecursionError,
    InputError,
)
"""What reading a file that is none raises."""
OF_WORDS = (".lookup", ".target", ".fit", ".up", FUNCTIONS)
"""Ends of the keys whose values are words, none of which may be a file's name."""
LOOKED_AGAIN = 0.2
"""Seconds after which a plan that another process is making is looked for again."""


@dataclass(frozen=True)
class RangePlan:
    """Decisions for all frames of a range."""

    decisions: Decisions
    """By dotted key of the scene file."""
    looked_at: tuple[int, ...]
    """Frames that they go by."""

    @property
    def overrides(self) -> list[tuple[str, Any]]:
        """Pairs of a dotted key and a value, as `SceneFile.read` takes them."""
        return [(key, decision.value) for key, decision in self.decisions.items()]

    @property
    def told(self) -> dict[str, Any]:
        """As `tfm_cl.plan.plan.Plan.told`."""
        return told_of(self.decisions)

    def lines(self) -> Iterator[str]:
        """Yield the decisions for people."""
        for key, (value, why) in self.decisions.items():
            shown = value.partition(":")[0] + " numbers" if key == FUNCTIONS else value
            yield f"{key} = {shown}: {why}"

    def save(self, path: Path, fingerprint: str, frames: Collection[int]) -> None:
        """Write it, whole or not at all."""
        from fileseq.frameset import FrameSet  # noqa: PLC0415 - few frames need none

        table = {
            "fingerprint": fingerprint,
            "frames": FrameSet.from_iterable(frames, sort=True).frameRange(),
            "looked_at": list(self.looked_at),
            "values": {key: value for key, (value, _) in self.decisions.items()},
            "why": {key: why for key, (_, why) in self.decisions.items()},
        }
        write_text(path, HEAD + to_toml(table))

    @classmethod
    def load(cls, path: Path) -> tuple[RangePlan, str, frozenset[int]] | None:
        """Read one, its fingerprint and its frames; None where there is none that can be used."""
        try:
            if not is_file(path):  # a pipe would never end
                return None
            with path.open("rb") as file:
                table = tomllib.loads(file.read(LARGEST).decode())
            values, why = table["values"], table["why"]
            if any(isinstance(value, str) and not key.endswith(OF_WORDS) for key, value in values.items()):
                return None  # a plan names no files
            decisions = {str(key): Decision(value, str(why.get(key, ""))) for key, value in values.items()}
            frames = frozenset(frames_of(str(table["frames"])))
            return cls(decisions, tuple(map(int, table["looked_at"]))), str(table["fingerprint"]), frames
        except NO_PLAN:
            return None


HEAD = """\
# What tfm decided once for all frames of a range, so that nothing jumps between them.
# It is used again as long as the scene and the frames looked at are the same; delete it to decide anew.

"""


def steady(
    shot: Shot,
    frames: Collection[int],
    path: Path,
    ledger: Ledger,
    *,
    exposes: bool = False,
    renderer: Callable[[], Renderer] | None = None,
) -> RangePlan:
    """Return what is decided for a range: what its file says, or now, for whoever else makes its frames.

    Parameters
    ----------
    frames
        Of the range.
    path
        The plan's file: used if it is of the same scene, the frames that were looked at are what they were,
        and it is of all of these frames; else it is written.
    ledger
        Sees to it that one process decides.
    exposes, renderer
        As of `decide`.

    Raises
    ------
    InputError
        As `decide`; the file cannot be written, or holds values that somebody made impossible.
    """
    while True:
        if (found := _fitting(shot, frames, path, exposes=exposes)) is not None:
            return found
        claim = ledger.claim(path.name)
        if claim is None:
            time.sleep(LOOKED_AGAIN)
            continue
        try:
            if (found := _fitting(shot, frames, path, exposes=exposes)) is not None:
                return found
            decided = decide(shot, frames, exposes=exposes, renderer=renderer)
            decided.save(path, _fingerprint(shot, decided.looked_at, exposes=exposes), frames)
            return decided
        finally:
            ledger.release(claim)


def _fitting(shot: Shot, frames: Collection[int], path: Path, *, exposes: bool) -> RangePlan | None:
    """Return the plan that a file holds, if it is of these frames."""
    loaded = RangePlan.load(path)
    if loaded is None:
        return None
    found, said, of = loaded
    if not of.issuperset(frames):
        return None
    try:
        fits = said == _fingerprint(shot, found.looked_at, exposes=exposes)
    except InputError:  # a frame that was looked at is gone
        return None
    if not fits:
        return None
    try:
        replace(shot, decided=found.overrides).scene_file(next(iter(found.looked_at), None))
    except InputError as error:  # somebody changed it
        wrong = "; ".join(map(str, error.args))
        raise InputError(f"{path}: {wrong}; correct it, or delete the file to decide anew") from None
    return found


def _fingerprint(shot: Shot, frames: Iterable[int], *, exposes: bool) -> str:
    """Return what decisions are made from, as a number: the scene's text, what is set, and these frames."""
    path = Path(shot.path)
    try:
        text = path.read_bytes() if path.suffix.lower() == ".toml" else b""
    except OSError:
        text = b""  # a pattern of scene files: their states follow
    files = [states(shot.scene_file(frame)) for frame in frames]
    said = [path.name, text.hex(), shot.overrides, shot.look, shot.turntable, exposes, files]
    return fingerprint(said)


def looked_at(frames: Collection[int]) -> list[int]:
    """Return the frames that decisions go by."""
    places = np.linspace(0, len(frames) - 1, min(len(frames), MOST_LOOKED_AT))
    ordered = sorted(frames)
    return [ordered[round(place)] for place in places.tolist()]


def decide(
    shot: Shot,
    frames: Collection[int],
    *,
    exposes: bool = False,
    renderer: Callable[[], Renderer] | None = None,
) -> RangePlan:
    """Decide what a scene leaves open, for all frames of a range.

    Parameters
    ----------
    shot
        The scene; what has keyframes stays as it is.
    frames
        Of the range.
    exposes
        Whether pictures are written that an exposure is chosen for.
    renderer
        Gives what renders scenes; called only where the device alone can tell. None: that is left open.

    Raises
    ------
    InputError
        None of the frames that were looked at can be read: what is wrong with the first.
    """
    samples, errors, room = list[_Sample](), list[InputError](), KEPT_VALUES
    animated = set[str]()
    for frame in looked_at(frames):
        try:
            sample = _look_at(shot, frame)
        except InputError as error:
            errors.append(error)
            continue
        animated |= {".".join(map(str, key)) for key in sample.file.changing}
        room -= sum(math.prod(body.shape) for body in sample.bodies or () if isinstance(body, Volume))
        samples.append(sample if room >= 0 else sample._replace(bodies=None))
        if not sample.file.changing and FilePattern.of(shot.path) is None:
            break
    if not samples:
        raise errors[0]

    def free(found: Iterable[tuple[str, Decision]]) -> dict[str, Decision]:
        return {key: decision for key, decision in found if key not in animated}

    decisions = free(_chosen(samples)) | free(_placed(samples))
    scenes = [_scene(shot, sample, decisions) for sample in samples]
    plans = [plan(scene, file=file) for file, scene in scenes]
    densest = max(range(len(samples)), key=lambda number: samples[number].depth)
    decisions |= free(_combined(plans, samples, densest))
    open_ = {key for one in plans for key, (value, _) in one.decisions.items() if value is None}
    if not exposes:
        open_.discard(EXPOSURE)
    if open_ and renderer is not None:
        scenes = [_scene(shot, sample, decisions) for sample in samples]
        decisions |= free(_measured(scenes, plans, densest, open_, renderer().render))
    if FUNCTIONS not in animated and renderer is not None and any(map(_learns, plans)):
        scenes = [_scene(shot, sample, decisions) for sample in samples]
        decisions |= dict(_learnt(scenes, renderer))
    return RangePlan(decisions, tuple(sample.frame for sample in samples))


class _Seen:
    """Where a body is, for what is placed by it."""

    def __init__(self, body: Body) -> None:
        self._bounds, self._outline = body.occupied_bounds, body.outline()

    @property
    def occupied_bounds(self) -> NDArray[np.float64]:
        """As `Body.occupied_bounds`."""
        return self._bounds

    def outline(self) -> NDArray[np.float64]:
        """As `Body.outline`."""
        return self._outline


class _Sample(NamedTuple):
    """A frame that was looked at, on its own."""

    frame: int
    file: SceneFile
    bodies: tuple[Body, ...] | None
    """None where they are too large to be kept, or something of them was chosen."""
    seen: Sequence[_Seen]
    depth: float
    """How deep its media are, to compare frames by."""
    chosen: Mapping[str, Decision]
    """What its bodies' files leave open."""
    grounds: Mapping[str, Decision]


def _look_at(shot: Shot, frame: int) -> _Sample:
    file = shot.scene_file(frame)
    scene = file.make(Scene)
    there = [body for body in scene.bodies if not isinstance(body, Homogeneous) or body.density]
    chosen, depth = dict[str, Decision](), 0.0
    for number, settings, volume in grids(file, scene):
        typical = scene.medium_of(volume).typical_depth
        if settings.density_scale == "auto" and any(lines.any() for lines in volume.line_depths()):
            chosen[f"volume.{number}density_scale"] = Decision(volume.density_scale, why_density(typical))
    for place, body in enumerate(scene.bodies):
        if isinstance(body, MarchedBody):
            depth += max((float(lines.max(initial=0.0)) for lines in body.line_depths()), default=0.0)
        if isinstance(body, Primitives):
            several = f"{place}." if len(scene.bodies) > 1 else ""
            chosen |= {f"volume.{several}{key}": Decision(*found) for key, found in body.chosen.items()}
    return _Sample(
        frame,
        file,
        None if any(isinstance(body, Primitives) for body in scene.bodies) else scene.bodies,
        [_Seen(body) for body in there or scene.bodies],
        depth,
        chosen,
        dict(_grounds(file, scene)),
    )


def _grounds(file: SceneFile, scene: Scene) -> Iterator[tuple[str, Decision]]:
    for i, (asked, found) in enumerate(zip(file.solids, scene.solids, strict=True)):
        for key, why in GROUND.items() if isinstance(asked, GroundSolid) else ():
            if getattr(asked, key) == "auto":
                yield f"solid.{i}.{key}", Decision(getattr(found, key), why)


def _scene(shot: Shot, sample: _Sample, decisions: Decisions) -> tuple[SceneFile, Scene]:
    """Return a frame's scene with what is decided."""
    decided = [(key, value) for key, (value, _) in decisions.items()]
    file = replace(shot, decided=decided).scene_file(sample.frame)
    like = None if sample.bodies is None else Made(sample.file, sample.bodies)
    return file, file.make(Scene, like)


def _chosen(samples: Sequence[_Sample]) -> Iterator[tuple[str, Decision]]:
    """Yield densities, and what else is taken from each file."""
    for key in dict.fromkeys(key for sample in samples for key in sample.chosen):
        found = [sample.chosen[key] for sample in samples if key in sample.chosen]
        if key.endswith((".density", ".density_scale")):
            least = min(found, key=lambda decision: float(decision.value))
            yield key, Decision(least.value, f"{least.why}, in the densest frame")
        else:
            yield key, found[len(found) // 2]
    for key, most in OF_FLAMES.items():
        values = {sample.file.medium.to_dict()[key] for sample in samples}
        if len(values) > 1:
            yield f"medium.{key}", Decision(min(values), f"{most} of all frames")


def _placed(samples: Sequence[_Sample]) -> Iterator[tuple[str, Decision]]:
    """Yield what is placed: around what has density in any of the frames."""
    file, seen = samples[0].file, [body for sample in samples for body in sample.seen]
    camera = placement.camera_for(seen, **looks.framing(file.look.name), **file.camera)
    yield from of_camera(camera, file, ", in all frames")
    if file.light is None:
        table = placement.light_for(seen, camera, **file.placed_light).to_dict()
        for key, why in PLACED.items():
            if key in table and key not in file.placed_light:
                yield f"light.{key}", Decision(table[key], f"{why}, in all frames")
    fullest = max(samples, key=lambda sample: len(sample.file.solids))  # what is not there has no number
    samples = [sample for sample in samples if len(sample.file.solids) == len(fullest.file.solids)]
    for key, (_, why) in fullest.grounds.items():
        found = [sample.grounds[key].value for sample in samples if key in sample.grounds]
        lowest = key.endswith("height")
        yield key, Decision(min(found) if lowest else found[0], f"{why}{', in all frames' * lowest}")


def _combined(
    plans: Sequence[Plan], samples: Sequence[_Sample], densest: int
) -> Iterator[tuple[str, Decision]]:
    """Yield one decision for those of each frame."""
    of = plans[densest].decisions
    for key, (value, why) in of.items():
        thin = key in OF_DENSEST and plans[densest].scene.primitives
        of_medium = key.split(".")[-1] in octaves.KEYS
        if value is not None and (thin or of_medium or surroundings.is_key(key)):
            yield key, Decision(value, f"{why}, in frame {samples[densest].frame}, the densest")
        elif key in COUNTS and value is not None:
            counts = [one.decisions[key].value for one in plans if key in one.decisions]
            most = max(range(len(counts)), key=counts.__getitem__)
            yield (
                key,
                Decision(counts[most], f"{plans[most].decisions[key].why}, in frame {samples[most].frame}"),
            )
    lookups = dict.fromkeys(one.map.lookup for one in plans if one.map is not None)
    if samples[0].file.map.lookup == "auto" and lookups:
        lattice = list(lookups) == ["lattice"]
        found = next((name for name in lookups if name != "lattice"), "lattice")
        yield (
            "map.lookup",
            Decision(found, of["map.lookup"].why if lattice else "what the basis is best with"),
        )


def _measured(
    scenes: Sequence[tuple[SceneFile, Scene]],
    plans: Sequence[Plan],
    densest: int,
    opened: Collection[str],
    render: Callable[..., RenderResult],
) -> Iterator[tuple[str, Decision]]:
    """Yield what only rendering can tell: of small pictures, unless an error is to be kept."""
    keeps_error = any(scene.map.max_error is not None for _, scene in scenes)
    if keeps_error:  # each of them is measured again and again
        scenes = [scenes[number] for number in sorted({0, densest, len(scenes) - 1})]
    results = []
    for file, scene in scenes:
        if not keeps_error:
            width, height = scene.camera.res
            smaller = max(width // PILOT_WIDTH, 1)
            small = max(width // smaller, 1), max(height // smaller, 1)
            scene = scene.replace(camera=scene.camera.replace(res=small))  # noqa: PLW2901
        results.append((file, render(scene, background=file.image.background)))
    whys = {key: why for key, (_, why) in plans[densest].decisions.items()}
    if keeps_error:
        maps = [result.stats.map for _, result in results if result.stats.map is not None]
        steps = {"march.steps": [decided(result.scene.march.steps) for _, result in results]}
        of_maps = {f"map.{key}": [getattr(one, key) for one in maps] for key in ("coeffs", "res", "steps")}
        for key, found in (of_maps | steps).items():
            if found and (key in opened or key == "map.coeffs"):
                yield key, Decision(max(found), f"{whys.get(key, 'as given')}, in all frames looked at")
        if maps and scenes[0][0].map.lookup == "auto":
            lookups = [one.lookup for one in maps]
            lookup = next((name for name in lookups if name != "lattice"), "lattice")
            yield "map.lookup", Decision(lookup, "what serves the error asked for, in all frames looked at")
    weightings = [
        result.stats.map.density_weighting
        for _, result in results
        if result.stats.map is not None and result.stats.map.density_weighting is not None
    ]
    if WEIGHTING in opened and weightings:
        yield WEIGHTING, Decision(max(weightings), f"{whys[WEIGHTING]}, the largest of all frames looked at")
    if EXPOSURE in opened:
        image = results[0][0].image
        pictures = [result.picture(transparent=image.transparent).reshape(-1, 1, 4) for _, result in results]
        stops = automatic_exposure(np.concatenate(pictures), image.view, transparent=image.transparent)
        yield EXPOSURE, Decision(stops, f"{WHY_AUTOMATIC}, of all frames looked at")


def _learns(planned: Plan) -> bool:
    """Whether maps learn what may be learnt once; those for a ``max_error`` are not known yet."""
    measured = planned.scene.map.max_error is not None
    return measured if planned.map is None else planned.map.learns and planned.map.lasts


def _learnt(
    scenes: Sequence[tuple[SceneFile, Scene]], renderer: Callable[[], Renderer]
) -> Iterator[tuple[str, Decision]]:
    """Yield what the basis learns."""
    try:
        # What keeps an error is decided by now.
        plain = [scene.replace(map=scene.map.replace(max_error=None)) for _, scene in scenes]
        functions = renderer().functions_for(plain)
    except NoDeviceError:  # others have: each frame learns for itself
        return
    if functions is not None:
        yield FUNCTIONS, Decision(functions, "learnt from rays of all lights in all frames looked at")
