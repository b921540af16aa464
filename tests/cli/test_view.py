"""`tfm view`: what is refused before anything is served, what is printed, and how it ends."""

import asyncio
import json
import os
import signal
import socket
import subprocess
import threading
import webbrowser

import pytest

from tfm_cl.cli import view as view_command
from tfm_cl.device.kernel_cache import COMPILING

pytest.importorskip("tornado")
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from tfm_cl.viewer import loop as loop_module
from tfm_cl.viewer import server as server_module

SECONDS = 60
"""Until something that should happen counts as missing; other tests may keep the machine busy."""


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("nowhere.vdb",), "no such file"),
        (("CLOUD", "--port", "65536"), "--port"),
        (("CLOUD", "--port", "x"), "--port"),
        (("CLOUD", "--host", ""), "--host: should be an address"),
        (("CLOUD", "--host", "192.0.2.1"), "--host 192.0.2.1: "),
        (("CLOUD", "--folder", "nowhere"), "nowhere: is not a folder"),
        (("CLOUD", "--folder", "cloud.npy"), "cloud.npy: is not a folder"),
        (("CLOUD", "--frame", "nan"), "--frame"),
        (("CLOUD", "--set", "map.coefs=8"), "did you mean 'coeffs'"),
        (("scene.toml",), "nowhere.vdb"),
        (("broken.vdb",), "broken.vdb"),
    ],
)
def test_wrong_input_is_refused_before_anything_is_served(refused, cloud, arguments, told):
    (cloud.parent / "scene.toml").write_text('[volume]\nfile = "nowhere.vdb"\n')
    (cloud.parent / "broken.vdb").write_bytes(b"no volume")
    assert told in refused(
        "view", "--no-browser", *(cloud if part == "CLOUD" else part for part in arguments)
    )


def test_a_device_that_is_not_there_is_told_before_anything_is_served(cli, cloud):
    done = cli("view", cloud, "--device", "no such device", "--no-browser")
    assert (done.code, done.out) == (3, "")
    assert "no such device" in done.err
    assert done.err.count("\n") == 1


def test_a_taken_port_is_refused(refused, cloud):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"--port {port}: is taken" in refused("view", cloud, "--port", port, "--no-browser")


@pytest.fixture
def served(monkeypatch):
    """The command does not wait; returns the pages that a browser was asked to open."""
    opened = []

    class Browser(webbrowser.BackgroundBrowser):
        def open(self, address):
            opened.append(address)
            return True

    monkeypatch.setattr(webbrowser, "get", lambda: Browser("none"))
    monkeypatch.setattr(server_module.Server, "run", wait_for_the_browser)
    return opened


def wait_for_the_browser(_server):
    for thread in threading.enumerate():
        if thread.name == view_command.BROWSER:
            thread.join(SECONDS)


def test_the_address_comes_first_and_is_opened(cli, cloud, served):
    done = cli("view", cloud, "--port", "0")

    assert done.code == 0, done.err
    assert done.out.startswith("http://127.0.0.1:")
    assert done.out.count("\n") == 1
    assert served == [done.out.strip()]


def test_no_browser_is_opened_where_none_is_wanted(cli, cloud, served):
    assert cli("view", cloud, "--port", "0", "--no-browser").out.startswith("http://")
    assert served == []


@pytest.mark.usefixtures("served")
def test_others_are_told_a_token(cli, cloud):
    done = cli("view", cloud, "--port", "0", "--host", "127.0.0.1", "--no-browser")
    assert "/?token=" in done.out


@pytest.mark.usefixtures("served")
def test_a_browser_of_the_terminal_is_left_alone(cli, cloud, monkeypatch):
    monkeypatch.setattr(webbrowser, "get", lambda: webbrowser.GenericBrowser("lynx"))
    done = cli("view", cloud, "--port", "0")
    assert done.err == "tfm: note: no browser was found: open the address in one\n"


@pytest.mark.usefixtures("served")
def test_a_compiler_is_not_waited_for(cli, cloud, monkeypatch):
    """It cannot be stopped; what would be removed at the end of the process is removed before."""
    done = []

    def interrupted(_server):
        raise KeyboardInterrupt

    monkeypatch.setattr(server_module.Server, "run", interrupted)
    monkeypatch.setattr(loop_module.RenderLoop, "is_at_work", True)
    monkeypatch.setattr(view_command.atexit, "_run_exitfuncs", lambda: done.append("removed"))
    monkeypatch.setattr(view_command.os, "_exit", done.append)
    ended = cli("view", cloud, "--port", "0", "--no-browser")

    assert done == ["removed", 130]
    assert ended.err.startswith("tfm: interrupted\n")


class Serving:
    """``tfm view`` in a process of its own."""

    def __init__(self, command, folder, temporary):
        self.temporary = temporary
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"TMPDIR": str(temporary)},
            cwd=folder,
        )
        self.address = self.process.stdout.readline().strip()

    def connect(self, number):
        """Be a client, send a signal once there is work, and return with what words the connection ends."""

        async def program():
            origin = self.address.removesuffix("/")
            request = HTTPRequest(f"ws{origin.removeprefix('http')}/socket", headers={"Origin": origin})
            client = await websocket_connect(request)
            while (message := await asyncio.wait_for(client.read_message(), SECONDS)) is not None:
                said = json.loads(message) if isinstance(message, str) else {"type": "picture"}
                if said["type"] == "state":  # it is rendered from now on, or compiled
                    await asyncio.sleep(0.2)
                    self.process.send_signal(number)
            client.close()
            return client.close_reason

        return asyncio.run(program())

    def ended(self):
        """Wait for the end; returns its code and output."""
        out, err = self.process.communicate(timeout=SECONDS)
        assert list(self.temporary.iterdir()) == []
        return self.process.returncode, out, err.replace(f"tfm: {COMPILING}\n", "")


@pytest.fixture
def serving(cloud, program, tiny, tmp_path_factory):
    """``tfm view`` of a small cloud, at any port."""
    if os.name != "posix":
        pytest.skip("signals as POSIX sends them")
    command = program("view", cloud, "--no-browser", "--port", "0", *tiny)
    found = Serving(command, cloud.parent, tmp_path_factory.mktemp("temporary"))
    assert found.address.startswith("http://127.0.0.1:"), found.process.communicate()
    yield found
    found.process.kill()
    found.process.communicate()


def test_ctrl_c_ends_it_at_once(serving, folder):
    before = sorted(folder.iterdir())
    serving.process.send_signal(signal.SIGINT)
    assert serving.ended() == (130, "", "tfm: interrupted\n")
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "code", "told"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")]
)
def test_it_ends_while_it_renders(serving, folder, name, code, told):
    before = sorted(folder.iterdir())
    assert serving.connect(getattr(signal, name)) == "the viewer has ended"
    assert serving.ended() == (code, "", f"tfm: {told}\n")
    assert sorted(folder.iterdir()) == before


def test_the_help_says_what_is_safe(cli):
    done = cli("view", "--help")
    assert done.code == 0
    for flag in ("--port", "--host", "--no-browser", "--shared", "--folder", "--frame", "--set", "--device"):
        assert flag in done.out
