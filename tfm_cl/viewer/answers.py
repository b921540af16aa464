"""What a session answers besides its pictures: files, curves, comparisons and maps."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from tfm_cl.errors import InputError
from tfm_cl.files.paths import write_text
from tfm_cl.scene.scene_file_writer import scene_text
from tfm_cl.viewer import pictures
from tfm_cl.viewer.messages import Compare, Pick, Save, ShowMap

if TYPE_CHECKING:
    from pathlib import Path

    from tfm_cl.device.launch import Progress
    from tfm_cl.files.image_io.inline import Quality
    from tfm_cl.viewer.clients import Clients
    from tfm_cl.viewer.edits import Edits, Settings
    from tfm_cl.viewer.files import Files
    from tfm_cl.viewer.mailbox import Mailbox
    from tfm_cl.viewer.messages import Show
    from tfm_cl.viewer.renderer import ReadFrame, Renderer, Result

WriteScene = Callable[["ReadFrame", "Path"], None]
ReadSettings = Callable[..., "ReadFrame"]
"""Reads settings, like a frame that is read, with what is set besides."""


class SeenPicture(NamedTuple):
    """What is shown last."""

    revision: int
    quality: Quality
    result: Result


class Now(NamedTuple):
    """What is looked at when something is answered."""

    read: ReadFrame
    settings: Settings
    aov: list[str]
    """Layers of its full picture."""
    revision: int
    seen: SeenPicture | None
    show: Show
    """How that is shown."""
    stops: float | None
    """The exposure that stands for ``"auto"``."""


class Asked(NamedTuple):
    """What is asked for besides pictures, by whom, and of what."""

    said: Save | Pick | Compare | ShowMap
    mailbox: Mailbox | None
    settings: Settings
    """When it was asked for, and so are saved."""
    show: Show


class Answers:
    """What is asked for waits here for its answer; of the render thread.

    Parameters
    ----------
    files
        Where files are saved.
    clients
        Who is told.
    read_settings
        Reads what is set.
    curve_at
        Follows the light to a pixel, as `tfm_cl.viewer.curve.curve_at` does.
    write_scene
        Writes a scene file of what is shown; None: of what files are named.
    """

    def __init__(
        self,
        files: Files,
        clients: Clients,
        read_settings: ReadSettings,
        curve_at: Callable[..., Any],
        write_scene: WriteScene | None,
    ) -> None:
        self._files, self._clients, self._read_settings = files, clients, read_settings
        self._curve_at, self._write_scene = curve_at, write_scene or _write_scene
        self._waiting: deque[Asked] = deque()
        self._kept: Edits | None = None
        self._compared: Asked | None = None
        """Made anew beside each full picture, as is the map."""
        self._map: Asked | None = None

    # What is asked for.

    @property
    def are_asked_for(self) -> bool:
        """Whether anything waits."""
        return bool(self._waiting)

    @property
    def is_one_urgent(self) -> bool:
        """Whether something waits that needs no full picture."""
        return any(map(_is_urgent, self._waiting))

    def ask(self, asked: Asked) -> None:
        """Ask for something; comparisons and maps are made again with each full picture."""
        match asked.said:
            case Compare() as said:
                self._compared = None if said.with_ == "nothing" else asked
                self._ask_for_one(Compare, self._compared)
                if self._compared is None:
                    self._clients.forget(pictures_of=("b", "error"))
            case ShowMap() as said:
                self._map = None if said.coefficient < 0 else asked
                self._ask_for_one(ShowMap, self._map)
                if self._map is None:
                    self._clients.forget(pictures_of=("map",))
            case _:
                self._waiting.append(asked)

    def keep(self, edits: Edits) -> None:
        """Keep what is set to compare with."""
        self._kept = edits
        if self._compared is not None and self._compared.said == _WITH_KEPT:
            self.compare_again()

    def compare_again(self) -> None:
        """Compare again, if anything is compared; all clients are told what is wrong with it."""
        if self._compared is not None:
            self._ask_for_one(Compare, self._compared._replace(mailbox=None))

    def all_again(self) -> None:
        """Make anew what is shown beside a full picture, which is another."""
        self.compare_again()
        if self._map is not None:
            self._ask_for_one(ShowMap, self._map._replace(mailbox=None))

    def _ask_for_one(self, kind: type[Compare | ShowMap], asked: Asked | None) -> None:
        """Ask for one of a kind in the place of another, or for none."""
        self._waiting = deque(one for one in self._waiting if not isinstance(one.said, kind))
        if asked is not None:
            self._waiting.append(asked)

    def end(self) -> None:
        """Show nothing beside pictures any more: another scene is looked at."""
        self._kept = self._compared = self._map = None
        self._clients.forget(pictures_of=("b", "error", "map"))

    def clear(self) -> None:
        """Leave unanswered what waits."""
        self._waiting.clear()

    # Answering.

    def take(self) -> Asked:
        """Take what is to be answered first: what needs no full picture."""
        asked = next(filter(_is_urgent, self._waiting), self._waiting[0])
        self._waiting.remove(asked)
        return asked

    def put_back(self, asked: Asked) -> None:
        """Ask again for what was taken."""
        self._waiting.appendleft(asked)

    def answer(self, asked: Asked, now: Now, renderer: Callable[[], Renderer], progress: Progress) -> None:
        """Do what was asked for.

        Raises
        ------
        InputError
            It cannot be done.
        """
        match asked.said:
            case Save() as said:
                self._save(asked, said, now, renderer, progress)
            case Pick() as said:
                self._pick(said, asked.mailbox, now, renderer())
            case Compare() as said:
                self._send_comparison(said, now, renderer(), progress)
            case ShowMap() as said:
                self._send_map(said, now, renderer(), progress)

    def _save(
        self, asked: Asked, said: Save, now: Now, renderer: Callable[[], Renderer], progress: Progress
    ) -> None:
        """Write what was shown when it was asked for, as ``tfm render`` writes it."""
        stops = now.stops if asked.show.exposure == "auto" else asked.show.exposure
        also = [("image.view", asked.show.view), *([] if stops is None else [("image.exposure", stops)])]
        read = self._read_settings(asked.settings, now.read, *also)
        if said.what == "scene" and (lost := read.file.lost_motion) is not None:
            raise InputError(f"{lost}; set image.shutter to [0, 0] and save it, or save the picture")
        path = self._files.saved(said.name, ".toml" if said.what == "scene" else f".{said.what}")
        if said.what == "scene":
            self._write_scene(read, path)
        else:
            read.render(renderer(), (path,), progress).save((path,))
        self._files.written(path)
        self._clients.tell(asked.mailbox, {"type": "saved", "what": said.what, "path": str(path)})

    def _pick(self, said: Pick, mailbox: Mailbox | None, now: Now, renderer: Renderer) -> None:
        if now.seen is None:
            raise InputError("there is no picture yet; pick again when there is")
        depth = pictures.seen_depth(now.seen.result.aovs)
        curve = self._curve_at(renderer, now.read, depth, said.x, said.y, said.light)
        self._clients.tell(mailbox, curve.to_dict())

    def _send_comparison(self, said: Compare, now: Now, renderer: Renderer, progress: Progress) -> None:
        seen = now.seen
        if seen is None or seen.quality != "full":
            return  # the full picture asks again
        aov = ("image.aov", now.aov)
        if said.with_ == "dual":
            read = self._read_settings(now.settings, now.read, aov, ("march.method", "dual"))
        elif self._kept is not None:
            read = self._read_settings(now.settings.as_kept(self._kept), now.read, aov)
        else:
            self._compared = None
            raise InputError("compare: nothing is kept to compare with; keep settings first")
        other = read.render(renderer, (), progress).result
        found = pictures.beside(seen.result, other, now.show)
        self._clients.send_shown("b", found.b, seen.revision, "full")
        self._clients.send_picture("error", found.error, seen.revision, "full", gain=found.gain)
        figures = pictures.figures(seen.result, other)
        self._clients.send({"type": "compared", "with": said.with_, "revision": seen.revision, **figures})

    def _send_map(self, said: ShowMap, now: Now, renderer: Renderer, progress: Progress) -> None:
        scene = now.read.scene
        if said.light >= len(scene.lights):
            raise InputError(f"light {said.light}: the scene has {len(scene.lights)}, counted from 0")
        maps = renderer.maps_of(scene, said.light, progress=progress)
        if not maps:
            raise InputError("map: there is none: all media are of constant density, or nothing lights them")
        field = min(said.field, len(maps) - 1)
        shown = pictures.shown_map(maps[field], said.coefficient)
        of = {"light": said.light, "coefficient": said.coefficient, "field": field, "fields": len(maps)}
        self._clients.send_shown("map", shown, now.revision, "full", **of)


_WITH_KEPT = Compare.model_validate({"with": "kept"})


def _is_urgent(asked: Asked) -> bool:
    """Tell whether something needs no full picture."""
    return isinstance(asked.said, Save | Pick)


def _write_scene(read: ReadFrame, path: Path) -> None:
    write_text(path, scene_text(read.options, path.parent, every_key=False))
