"""What tests of the viewer share: a client that remembers what it was sent, a renderer without a device."""

import json
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tfm_cl.errors import CancelledError, InputError, NoDeviceError
from tfm_cl.render.result import RenderResult, RenderStats
from tfm_cl.sequence.frame import read
from tfm_cl.sequence.shot import Shot
from tfm_cl.viewer.loop import RenderLoop
from tfm_cl.viewer.mailbox import Mailbox
from tfm_cl.viewer.messages import parsed

PATIENCE = 120.0
"""Seconds after which what a test waits for does not come."""
TEXT = """
[volume]
shape = "box"
from = [-0.5, -0.5, -0.5]
to = [0.5, 0.5, 0.5]
[camera]
from = [0, 0, 4]
to = [0, 0, 0]
res = [640, 360]
[[light]]
type = "sun"
from = [0, 9, 0]
to = [0, 0, 0]
intensity = 1
"""


class Client:
    """Takes all that its mailbox holds at once, and says that it has seen it."""

    def __init__(self, session=None):
        self.mailbox = Mailbox(self._ready)
        self.got = []
        self._changed = threading.Condition()
        self.session = session
        if session is not None:
            session.join(self.mailbox)

    def _ready(self):
        with self._changed:
            self._changed.notify_all()

    def take(self):
        """Take what there is; pictures have their header's keys and ``data``."""
        for message in self.mailbox.take():
            if isinstance(message, str):
                found = json.loads(message)
            else:
                size = int.from_bytes(message[:4], "little")
                found = json.loads(message[4 : 4 + size]) | {"data": message[4 + size :]}
                self.mailbox.seen(found["picture"])
            self.got.append(found | {"at": time.monotonic()})

    def say(self, type, **keys):  # noqa: A002 - the message's key
        """Say something, as a page does; returns how much was got before."""
        self.take()
        before = len(self.got)
        self.session.say(parsed(json.dumps({"type": type} | keys)), self.mailbox)
        return before

    def wait(self, type, after=0, **keys):  # noqa: A002 - the message's key
        """Wait for a message of a type that says so; ``after``: so many that were got before."""
        return self.wait_for(
            lambda found: found["type"] == type and all(found.get(key) == keys[key] for key in keys), after
        )

    def wait_for(self, is_it, after=0):
        end, looked = time.monotonic() + PATIENCE, after
        while True:
            self.take()
            while looked < len(self.got):
                if is_it(self.got[looked]):
                    return self.got[looked]
                looked += 1
            if time.monotonic() > end:
                raise AssertionError(f"it did not come; got {[_short(found) for found in self.got[after:]]}")
            with self._changed:
                self._changed.wait(0.005)

    def all(self, type, **keys):  # noqa: A002 - the message's key
        """All messages of a type so far that say so."""
        self.take()
        return [
            found
            for found in self.got
            if found["type"] == type and all(found.get(key) == keys[key] for key in keys)
        ]

    def picture(self, quality="full", after=0, which="a"):
        """Wait for a picture."""
        return self.wait("picture", after, quality=quality, which=which)

    @property
    def state(self):
        """The newest."""
        return self.all("state")[-1]


def _short(found):
    return {key: value for key, value in found.items() if len(repr(value)) < 200}


class FakeFiles:
    """A folder whose files may all be read."""

    most_upload, may_save = 1000, True

    def __init__(self, folder):
        self.folder = Path(folder)

    def check(self, paths):
        if any("secret" in Path(path).name for path in paths):
            raise InputError("secret: is outside the folder")

    def listing(self, name, kind):
        return {"type": "listing", "kind": kind, "path": name, "folders": [], "files": ["a.vdb"]}

    def opened(self, name):
        return self.folder / name

    def saved(self, name, suffix):
        return self.folder / (name if name.endswith(suffix) else name + suffix)

    def written(self, path):
        pass


class FakeRenderer:
    """Makes pictures as bright as the scene's first light, at once or when it is let."""

    made = 0

    def __init__(self):
        type(self).made += 1
        self.rendered, self.closed, self.cancelled = [], False, threading.Event()
        self.errors = []
        """Raised by the next pictures, one each; None: none."""
        self.on_compiling = None
        self.compiles = []
        """Programs that the next picture needs compiled."""
        self.samples = []
        """Of a pixel, that each picture was asked for with; None: one."""
        self.maps = []
        """Of any light."""
        self.seconds = {"low": 0.0, "full": 0.0}
        self.busy = threading.Event()
        """Set while a full picture is made."""

    def render(self, scene, *, crop=None, aovs=(), progress=None, samples=None, **_others):
        quality = "low" if samples is None else "full"
        self.rendered.append((quality, scene, tuple(aovs)))
        self.samples.append(samples)
        self.cancelled.clear()
        while self.compiles:
            self.on_compiling(self.compiles.pop(0))
        end = time.monotonic() + self.seconds[quality]
        if quality == "full":
            self.busy.set()
        try:
            while time.monotonic() < end:
                if self.cancelled.is_set():
                    raise CancelledError("cancelled")
                if progress is not None:
                    progress("view pass", 0.5)
                time.sleep(0.002)
        finally:
            self.busy.clear()
        error = self.errors.pop(0) if self.errors else None
        if error is not None:
            raise error
        width, height = scene.camera.res
        crop = crop or (0, 0, width, height)
        image = np.ones((crop[3] - crop[1], crop[2] - crop[0], 4), np.float32)
        image[..., :3] = np.asarray(scene.lights[0].intensity if scene.lights else 0) / 4
        layers = {"depth": image[..., 0], "transmittance": image[..., :3]}
        layers |= dict.fromkeys(aovs, image[..., 0])
        return RenderResult(image, layers, RenderStats("fake"), scene, crop)

    def maps_of(self, *_scene_and_light, **_others):
        return self.maps

    def cancel(self):
        self.cancelled.set()

    def forget_unused(self):
        pass

    def close(self):
        self.closed = True


class Studio:
    """A loop of such renderers in a folder with a scene, and its clients.

    ``ahead``: whether the scene is rendered before anybody looks. Others are of the first renderer.
    """

    def __init__(self, folder, *, ahead=False, seconds=0.0, compiles=(), errors=()):
        self.folder, self.renderers = folder, []
        self.seconds = {"low": seconds, "full": 0.0}
        """That pictures take."""
        self._of_first = {"compiles": list(compiles), "errors": list(errors)}
        self.refuses = False
        """Whether there is no device."""
        self.loop = RenderLoop(self._make, read, _curve_at, linger=0.1)
        self.write("scene.toml", TEXT)
        self.loop.start(read(Shot(folder / "scene.toml").scene_file(None), None) if ahead else None)

    def _make(self):
        if self.refuses:
            raise NoDeviceError("no OpenCL device")
        renderer = FakeRenderer()
        renderer.seconds = self.seconds
        vars(renderer).update(self._of_first)
        self._of_first = {}
        self.renderers.append(renderer)
        return renderer

    def write(self, name, text):
        (self.folder / name).write_text(text)

    def session(self, name="scene.toml", *overrides):
        return self.loop.session(Shot(self.folder / name, overrides), FakeFiles(self.folder))

    def client(self, name="scene.toml", *overrides):
        """Return the only client of a session, which has seen its first full picture."""
        client = Client(self.session(name, *overrides))
        client.picture("full")
        return client

    @property
    def renderer(self):
        """The newest."""
        return self.renderers[-1]

    def close(self):
        self.loop.close()
        self.loop._thread.join(10)
        assert not self.loop._thread.is_alive()
        assert all(renderer.closed for renderer in self.renderers)


def _curve_at(_renderer, _read, depth, x, _y, light):
    found = {"type": "curve", "light": light, "z": [], "x": x, "depth": list(depth.shape)}
    return SimpleNamespace(to_dict=lambda: found)
