"""The interface of a kind of bake."""

from __future__ import annotations

import contextlib
import secrets
import shutil
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from tfm_cl.errors import InputError
from tfm_cl.files.paths import reason_of
from tfm_cl.model import Model
from tfm_cl.scene.looks import PLAIN

if TYPE_CHECKING:
    from tfm_cl.bake.renderer import Renderer
    from tfm_cl.device.launch import Progress
    from tfm_cl.scene.scene import Scene

    MakeScene = Callable[[], Scene]
    """Makes a frame's scene."""


class Bake(Model):
    """What a scene is baked to: a subclass a kind, whose fields are its options.

    Each field is a flag of ``tfm bake``, with the field's description as its help.
    """

    SECTION: ClassVar[str] = "bake"
    NAME: ClassVar[str]
    """On the command line."""
    SUMMARY: ClassVar[str]
    """What it writes, for ``--help``."""
    LOOK: ClassVar[str] = PLAIN
    """Of bare volumes, where ``--look`` is not given."""
    TAKES_SEVERAL: ClassVar[bool] = False
    """Whether a sequence of scenes makes one result."""
    NOT_USED: ClassVar[tuple[str, ...]] = ("image.", "march.method")
    """What dotted keys of the scene begin with that make no difference; flags that set them are refused."""

    @abstractmethod
    def check(self, out: Path) -> None:
        """Find out, before the work is done, whether its result could be written.

        Raises
        ------
        InputError
            A name of the wrong kind, or nothing can be written there.
        """

    def check_scene(self, scene: Scene) -> None:
        """Find out, before anything is built, whether it can be baked, as far as settings tell.

        Raises
        ------
        SceneError
            Settings that cannot.
        """

    def bake(self, renderer: Renderer, scene: Scene, out: Path, progress: Progress) -> list[Path]:
        """As `bake_frames`, of one scene."""
        return self.bake_frames(renderer, [lambda: scene], out, progress)

    @abstractmethod
    def bake_frames(
        self, renderer: Renderer, frames: Sequence[MakeScene], out: Path, progress: Progress
    ) -> list[Path]:
        """Make it, of one scene after the other: of one alone, unless the kind ``TAKES_SEVERAL``.

        Parameters
        ----------
        renderer
            Does the work.
        frames
            Each makes a scene, as requested: what is ``"auto"`` is for the renderer's plan to decide. It may
            be called again, and is not kept, so that one is in memory at a time.
        out
            File or folder, as `check` found it right.

        Returns
        -------
        list of Path
            The files written.

        Raises
        ------
        SceneError
            A scene without what is to be baked.
        InputError
            Files that cannot be written.
        DeviceError
            Memory or compilation.
        """


def check_folder(out: Path) -> None:
    """Find out whether `filling` could write to a folder, there or not.

    Raises
    ------
    InputError
        As `filling`.
    """
    with contextlib.suppress(_TriedError), filling(out):
        raise _TriedError


@contextlib.contextmanager
def filling(out: Path) -> Iterator[Callable[[str], Path]]:
    """Give names to write to; the files appear in a folder together at the end, or none on any failure.

    Yields a function from a file's name in the folder to the path at which to write it. What is there under
    other names stays.

    Raises
    ------
    InputError
        The folder cannot be made, is none, or cannot be written to.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is not a folder; choose another name")
    if not out.parent.is_dir():
        raise InputError(f"{out}: there is no directory {out.parent}; create it first")
    new = not out.is_dir()
    temporary = (out.parent if new else out) / f".tfm-{secrets.token_hex(4)}.tmp"
    try:
        temporary.mkdir()
        yield lambda name: temporary / name
        if new:
            temporary.rename(out)
            return
        for path in sorted(temporary.iterdir()):
            path.replace(out / path.name)
    except OSError as problem:
        raise InputError(f"{out}: cannot be written ({reason_of(problem)})") from problem
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


class _TriedError(Exception):
    """Ends a trial without writing anything."""
