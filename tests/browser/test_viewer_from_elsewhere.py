"""What a page of somebody else can do to the viewer that is open in the same browser: nothing."""

import threading
from contextlib import closing
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tfm_cl.viewer.files import Files
from tfm_cl.viewer.server import Server

pytestmark = pytest.mark.slow

ATTACK = """
async (target) => {
  const told = {};
  told.socket = await new Promise((resolve) => {
    const socket = new WebSocket(target.replace("http", "ws") + "/socket");
    socket.onopen = () => resolve("open");
    socket.onerror = () => resolve("refused");
  });
  const attempt = (path, options) => fetch(target + path, { credentials: "include", ...options })
    .then((answer) => answer.text()).catch(() => "refused");
  told.page = await attempt("/", {});
  await attempt("/upload?name=theirs.vdb", { method: "POST", body: "data", mode: "no-cors" });
  told.frame = await new Promise((resolve) => {
    const frame = document.createElement("iframe");
    frame.src = target + "/";
    frame.onload = () => resolve(frame.contentDocument === null ? "not ours to see" : "readable");
    document.body.append(frame);
  });
  told.script = await new Promise((resolve) => {
    const script = document.createElement("script");
    script.src = target + "/";
    script.onload = () => resolve("loaded");
    script.onerror = () => resolve("refused");
    document.body.append(script);
  });
  return told;
}
"""


class Session:
    """A session that counts who sees it."""

    seen = 0

    def join(self, _mailbox):
        type(self).seen += 1

    def leave(self, _mailbox):
        pass

    def say(self, said, mailbox=None):
        pass


class Elsewhere(BaseHTTPRequestHandler):
    """Another web server on this machine, which browsers take for the same site."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>elsewhere</title>")

    def log_message(self, *_):
        pass


def running(serve, stop):
    thread = threading.Thread(target=serve)
    thread.start()
    return closing(_Closing(lambda: (stop(), thread.join(30))))


class _Closing:
    def __init__(self, close):
        self.close = close


@pytest.mark.parametrize("host", [None, "127.0.0.1"], ids=["open", "with a token"])
def test_other_pages_reach_nothing(browser, tmp_path, monkeypatch, host):
    monkeypatch.setattr(Session, "seen", 0)
    server = Server(Session, Files(tmp_path), host=host, port=0)
    elsewhere = ThreadingHTTPServer(("127.0.0.1", 0), Elsewhere)
    with (
        closing(server),
        running(server.run, server.stop),
        running(partial(elsewhere.serve_forever, 0.05), elsewhere.shutdown),
        closing(browser.new_context()) as context,
    ):
        ours = context.new_page()
        ours.goto(server.address)  # so that the browser has the token
        ours.wait_for_function("location.search === ''")
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{elsewhere.server_address[1]}/")
        told = page.evaluate(ATTACK, f"http://127.0.0.1:{server.port}")
        own = Session.seen
        frames = [frame for frame in page.frames if frame.url.startswith(f"http://127.0.0.1:{server.port}")]
    elsewhere.server_close()

    assert told == {"socket": "refused", "page": "refused", "frame": "not ours to see", "script": "refused"}
    assert not frames
    assert own == 1
    assert list(tmp_path.iterdir()) == []
