"""The viewer's web server: whom it answers, whom it refuses, and that nobody holds anybody else."""

import asyncio
import base64
import contextlib
import hashlib
import json
import re
import socket
import threading
import time
from itertools import count
from urllib.parse import quote

import pytest

from tfm_cl.errors import InputError
from tfm_cl.viewer import server as server_module
from tfm_cl.viewer.files import Files
from tfm_cl.viewer.messages import MOST_BYTES, Seen
from tfm_cl.viewer.server import MOST_FAULTS, Server

tornado = pytest.importorskip("tornado")
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest  # noqa: E402
from tornado.websocket import websocket_connect  # noqa: E402

SECONDS = 30
"""Until something that should happen counts as missing; other tests may keep the machine busy."""
MOST_UPLOAD = 1 << 20
UPGRADE = (
    "GET /socket HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
)
"""How a WebSocket begins, without saying of which page."""
SEND = "POST /upload?name=sent.vdb HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\n"
"""How an upload begins."""
PICTURE = bytes(4 << 20)
"""Larger than what the system keeps for a connection that nobody reads."""


class FakeSession:
    """A session that only tells who is there and what was said."""

    def __init__(self):
        self.mailboxes, self.said = [], []

    def join(self, mailbox):
        self.mailboxes.append(mailbox)
        mailbox.put({"type": "welcome", "said": len(self.said)})

    def leave(self, mailbox):
        self.mailboxes.remove(mailbox)

    def say(self, said, mailbox):
        if isinstance(said, Seen):
            mailbox.seen(said.picture)
            return
        self.said.append(said)
        mailbox.put({"type": "cleared"})

    def show(self, number):
        for mailbox in self.mailboxes:
            mailbox.put_picture({"type": "picture", "picture": number, "which": "a"}, PICTURE)


class Running:
    """A server in a thread, and a page's view of it."""

    def __init__(self, folder, **options):
        self.sessions, self._clients = [], []
        self.files = Files(folder, most_upload=MOST_UPLOAD)
        self.server = Server(self._new, self.files, port=0, **options)
        self.base = f"http://127.0.0.1:{self.server.port}"
        self._thread = threading.Thread(target=self.server.run)
        self._thread.start()

    def _new(self):
        self.sessions.append(FakeSession())
        return self.sessions[-1]

    def close(self):
        self.server.stop()
        self._thread.join(SECONDS)
        assert not self._thread.is_alive()
        self.server.close()

    def ask(self, path="/", **options):
        """Return the answer to a request."""

        async def fetch():
            return await AsyncHTTPClient().fetch(self.base + path, raise_error=False, **options)

        return asyncio.run(fetch())

    def send(self, name, data, **headers):
        headers = {"Origin": self.base, **headers}
        return self.ask(f"/upload?name={quote(name)}", method="POST", body=data, headers=headers)

    async def connect(self, query="", **headers):
        headers = {"Origin": self.base, **headers}
        address = f"ws://127.0.0.1:{self.server.port}/socket{query}"
        self._clients.append(
            await websocket_connect(HTTPRequest(address, headers=headers), max_message_size=1 << 30)
        )
        return self._clients[-1]

    def talk(self, program):
        """Run what connects."""

        async def run():
            try:
                return await asyncio.wait_for(program, SECONDS)
            finally:
                for client in self._clients:
                    protocol = client.protocol
                    client.close()
                    if protocol is not None:
                        protocol._abort()  # whatever it has not read
                self._clients.clear()

        return asyncio.run(run())

    def raw(self, text):
        """Return what is answered to bytes that no client library sends."""
        answer = b""
        with socket.create_connection(("127.0.0.1", self.server.port), timeout=SECONDS) as connection:
            connection.sendall(text.encode("latin-1"))
            while not (b"\r\n\r\n" in answer and answer.endswith(b"\n")) and (
                part := connection.recv(1 << 16)
            ):
                answer += part
        return answer.decode("latin-1")


@pytest.fixture
def running(tmp_path):
    """``running(…)`` starts a server with the options."""
    with contextlib.ExitStack() as stack:

        def start(**options):
            found = Running(tmp_path, **options)
            stack.callback(found.close)
            return found

        yield start


@pytest.fixture
def local(running):
    """One for this machine only."""
    return running()


async def told(client):
    text = await client.read_message()
    return None if text is None else json.loads(text)


async def until(true):
    while not true():  # noqa: ASYNC110 - what it waits for happens in another thread
        await asyncio.sleep(0.01)


def number_of(picture):
    return json.loads(picture[4 : 4 + int.from_bytes(picture[:4], "little")])["picture"]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def hash_of(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def test_the_page_runs_its_own_script_and_is_shown_by_nobody_else(local):
    answer = local.ask()
    page, policy = answer.body.decode(), answer.headers["Content-Security-Policy"]
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)

    assert answer.code == 200
    assert f"script-src {hash_of(script)};" in policy
    assert f"style-src {hash_of(style)};" in policy
    assert "default-src 'none';" in policy
    assert "frame-ancestors 'none'" in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert answer.headers["Cache-Control"] == "no-store"
    assert set(re.findall(r"<[^>]+ (?:src|href)=[\"']?(\w+:?)", page)) <= {"data:"}


def test_there_is_nothing_else(local):
    assert local.ask("/favicon.ico").code == 204
    for path in ("/index.html", "/../pyproject.toml", "/start.js", "/%2e%2e/x", "/socket/"):
        answer = local.ask(path)
        assert (answer.code, answer.body.count(b"\n")) == (404, 1)
    assert local.ask("/", method="POST", body=b"", headers={"Origin": local.base}).code == 405
    assert local.ask("/socket", headers={"Origin": local.base}).code == 400


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:80", "localhost.evil.example", "192.168.0.1", "127.0.0.1.evil", "1"],
)
def test_a_name_that_is_made_to_lead_here_is_refused(local, host):
    for path in ("/", "/socket", "/upload?name=a.npy", "/x"):
        answer = local.ask(path, headers={"Host": host, "Origin": f"http://{host}"})
        assert answer.code == 403
    assert "tfm view" not in local.ask("/", headers={"Host": host}).body.decode()


@pytest.mark.parametrize("host", ["localhost:9000", "127.0.0.1", "LocalHost", "[::1]:8090"])
def test_a_tunnel_has_another_port(local, host):
    assert local.ask("/", headers={"Host": host}).code == 200


@pytest.mark.parametrize(
    "hosts", ["", "Host: \r\n", "Host: 127.0.0.1@evil\r\n", "Host: 127.0.0.1\r\nHost: evil.example\r\n"]
)
def test_a_request_names_one_host(local, hosts):
    answer = local.raw(f"GET / HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n")
    assert not answer.startswith("HTTP/1.1 200")
    assert "<html" not in answer


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://BASE", ""])
def test_other_pages_are_refused(local, tmp_path, origin):
    origin = origin.replace("BASE", local.base.removeprefix("http://"))

    async def program():
        with pytest.raises(HTTPClientError) as refused:
            await local.connect(Origin=origin)
        return refused.value.code

    assert local.talk(program()) == 403
    assert local.send("a.npy", b"x", Origin=origin).code == 403
    assert not local.sessions
    assert names(tmp_path) == []


def test_a_client_that_does_not_say_which_page_it_is_is_refused(local, tmp_path):
    head = "GET /socket HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    answer = local.raw(
        head + "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )
    assert answer.startswith("HTTP/1.1 403")
    assert local.ask("/upload?name=a.npy", method="POST", body=b"x").code == 403
    assert names(tmp_path) == []


def test_others_need_the_token(running):
    server = running(host="127.0.0.1")
    token = server.server.token
    assert server.server.address == f"{server.base}/?token={token}"
    assert len(token) >= 40
    for path in (
        "/",
        "/?token=",
        f"/?token={token[:-1]}",
        f"/?token={token}x",
        f"/?token=x&token={token}",
        "/x",
    ):
        assert server.ask(path).code == 403
    for cookie in ("", f"{server.server.cookie}=x", f"other={token}"):
        assert server.ask("/", headers={"Cookie": cookie}).code == 403
        assert server.send("a.npy", b"x", Cookie=cookie).code == 403


def test_the_token_is_shown_once(running):
    server = running(host="127.0.0.1")
    answer = server.ask(f"/?token={server.server.token}")
    cookie, *attributes = answer.headers["Set-Cookie"].split("; ")

    assert answer.code == 200
    assert {"HttpOnly", "SameSite=Strict"} <= set(attributes)
    assert server.server.token not in answer.body.decode()

    async def program():
        with pytest.raises(HTTPClientError):
            await server.connect()
        client = await server.connect(Cookie=cookie)
        return await told(client)

    assert server.ask("/", headers={"Cookie": cookie}).code == 200
    assert server.talk(program())["type"] == "welcome"


def test_all_addresses_have_the_machine_s_name(running, monkeypatch):
    monkeypatch.setattr(server_module.socket, "gethostname", lambda: "Render7.lab")
    server = running(host="0.0.0.0")  # noqa: S104 - what is tested
    cookie = {"Cookie": f"{server.server.cookie}={server.server.token}"}

    assert server.server.address.startswith("http://Render7.lab:")
    for host in ("render7.lab:80", "render7.local", "10.1.2.3:80", "localhost"):
        assert server.ask("/", headers={"Host": host, **cookie}).code == 200
    assert server.ask("/", headers={"Host": "evil.example", **cookie}).code == 403


def test_what_a_page_says_reaches_its_session(local):
    async def program():
        client = await local.connect()
        welcome = await told(client)
        await client.write_message('{"type": "undo"}')
        return welcome, await told(client)

    assert local.talk(program()) == ({"type": "welcome", "said": 0}, {"type": "cleared"})
    assert [said.type for said in local.sessions[0].said] == ["undo"]


def test_what_is_no_message_is_told_in_a_line(local):
    bad = ["", "[]", '{"type": "no"}', '{"type": "edit", "changes": NaN}', b"\0binary", "[" * 10_000]

    async def program():
        client = await local.connect()
        await told(client)
        for message in bad:
            await client.write_message(message, binary=isinstance(message, bytes))
            answer = await told(client)
            assert answer["type"] == "failed"
            assert answer["line"]
            assert "\n" not in answer["line"]
        for _ in range(MOST_FAULTS - len(bad)):
            await client.write_message("no")
        while await client.read_message() is not None:
            pass
        return client.close_code

    assert local.talk(program()) == 1008
    assert local.sessions[0].said == []


def test_a_message_that_is_too_large_ends_the_connection(local):
    async def program():
        client = await local.connect()
        await told(client)
        await client.write_message("x" * (MOST_BYTES + 1))
        assert await client.read_message() is None
        await until(lambda: not local.sessions[0].mailboxes)
        return client.close_code, client.close_reason

    assert local.talk(program()) == (1009, "message too big")
    assert local.sessions[0].said == []


def test_each_client_has_a_session_of_its_own(local):
    async def program():
        one, other = await local.connect(), await local.connect()
        await told(one), await told(other)
        await one.write_message('{"type": "undo"}')
        await told(one)

    local.talk(program())
    assert [len(session.said) for session in local.sessions] == [1, 0]


def test_shared_clients_have_one(running):
    server = running(shared=True)

    async def program():
        clients = [await server.connect() for _ in range(3)]
        for client in clients:
            await told(client)
        (session,) = server.sessions
        assert len(session.mailboxes) == 3
        clients[0].close()
        await until(lambda: len(session.mailboxes) == 2)

    server.talk(program())


def test_a_page_that_is_loaded_again_has_its_session(local):
    async def program():
        for said in range(2):
            client = await local.connect("?session=abcdefgh-ABCDEFGH_0123")
            assert (await told(client))["said"] == said
            await client.write_message('{"type": "undo"}')
            await told(client)
            client.close()
            await until(lambda: not local.sessions[0].mailboxes)
        await local.connect("?session=../../x")

    local.talk(program())
    assert len(local.sessions) == 2


def test_sessions_of_those_who_stay_away_are_dropped(tmp_path, monkeypatch):
    now = count(0.0, server_module.KEPT / 2)
    monkeypatch.setattr(server_module.time, "monotonic", lambda: next(now))
    with contextlib.closing(Server(FakeSession, Files(tmp_path), port=0)) as server:
        first = server.join("a" * 16)[1]
        server.leave("a" * 16)
        assert server.join("a" * 16)[1] is first
        server.leave("a" * 16)
        server.join("b" * 16)
        server.join("c" * 16)
        assert server.join("a" * 16)[1] is not first


def test_few_sessions_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(server_module, "MOST_KEPT", 2)
    with contextlib.closing(Server(FakeSession, Files(tmp_path), port=0)) as server:
        sessions = {}
        for name in "abcd":
            sessions[name] = server.join(name * 16)[1]
            server.leave(name * 16)
        assert server.join("d" * 16)[1] is sessions["d"]
        assert server.join("a" * 16)[1] is not sessions["a"]


def test_one_client_too_many_is_refused(local, monkeypatch):
    monkeypatch.setattr(server_module, "MOST_CLIENTS", 1)

    async def program():
        await local.connect()
        with pytest.raises(HTTPClientError) as refused:
            await local.connect()
        return refused.value.code

    assert local.talk(program()) == 503


def test_a_client_that_does_not_read_holds_nobody(running):
    server = running(shared=True)

    async def program():
        with socket.create_connection(("127.0.0.1", server.server.port)) as slow:
            slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 12)
            slow.sendall(f"{UPGRADE}Origin: http://127.0.0.1\r\n\r\n".encode())
            quick = await server.connect()
            await told(quick)
            await until(lambda: len(server.sessions[0].mailboxes) == 2)
            for number in range(20):
                server.sessions[0].show(number)
                picture = await quick.read_message()
                assert len(picture) > len(PICTURE)
                await quick.write_message(json.dumps({"type": "seen", "picture": number}))
        # A tab that was killed is noticed.
        await until(lambda: len(server.sessions[0].mailboxes) == 1)

    server.talk(program())


def test_the_next_picture_waits_until_the_last_is_seen(local):
    async def program():
        client = await local.connect()
        await told(client)
        local.sessions[0].show(0)
        first = await client.read_message()
        for number in range(1, 5):
            local.sessions[0].show(number)
        await client.write_message('{"type": "undo"}')
        assert (await told(client))["type"] == "cleared"  # and no picture before
        await client.write_message('{"type": "seen", "picture": 0}')
        last = await client.read_message()
        return [
            json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])["picture"] for data in (first, last)
        ]

    assert local.talk(program()) == [0, 4]


def test_who_is_connected_hears_of_the_end(tmp_path):
    server = Running(tmp_path)

    async def program():
        client = await server.connect()
        await told(client)
        started = time.monotonic()
        server.server.stop()
        while await client.read_message() is not None:
            pass
        return client.close_code, client.close_reason, time.monotonic() - started

    *said, seconds = server.talk(program())
    server.close()
    assert said == [1001, "the viewer has ended"]
    assert seconds < SECONDS / 2
    with socket.socket() as again:
        assert again.connect_ex(("127.0.0.1", server.server.port)) != 0


def test_an_upload_is_there_when_it_is_whole(local, tmp_path):
    data = bytes(range(256)) * 4000
    answers = [local.send("cloud.vdb", data) for _ in range(2)]

    assert [json.loads(answer.body) for answer in answers] == [{"path": "cloud.vdb"}, {"path": "cloud-2.vdb"}]
    assert [path.read_bytes() == data for path in sorted(tmp_path.iterdir())] == [True, True]


def test_a_table_of_a_phase_function_is_sent_as_one(local, tmp_path):
    query, headers = "/upload?name=cloud.txt&kind=phase", {"Origin": local.base}
    answer = local.ask(query, method="POST", body=b"-1 1\n1 2\n", headers=headers)
    assert json.loads(answer.body) == {"path": "cloud.txt"}
    assert names(tmp_path) == ["cloud.txt"]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("../a.vdb", "folder"),
        ("/etc/a.vdb", "folder"),
        ("b/a.vdb", "plain name"),
        ("a.exe", "known"),
        ("a", "known"),
        (".a.vdb", "hidden"),
        ("C:a.vdb", "not every system"),
        ("a\0.vdb", "control"),
        ("a\n.vdb", "control"),
        ("nul.vdb", "not every system"),
        ("%s%n.txt", "known"),
        ("x" * 300 + ".vdb", "longer"),
    ],
)
def test_uploads_with_other_names_are_refused_in_a_line(local, tmp_path, name, told):
    answer = local.send(name, b"data")
    assert answer.code == 400
    assert told in answer.body.decode()
    assert answer.body.count(b"\n") == 1
    assert names(tmp_path) == []


def test_an_upload_has_a_name(local, tmp_path):
    for query in ("", "?name=a.vdb&name=b.vdb"):
        answer = local.ask("/upload" + query, method="POST", body=b"x", headers={"Origin": local.base})
        assert answer.code == 400
    for kind in ("else", "scene&kind=scene"):
        query = f"/upload?name=a.vdb&kind={kind}"
        answer = local.ask(query, method="POST", body=b"x", headers={"Origin": local.base})
        assert (answer.code, answer.body) == (400, b"a file is of one kind: scene or phase\n")
    assert local.ask("/upload?name=a.vdb", headers={"Origin": local.base}).code == 405
    assert local.send("a.vdb", b"").code == 400
    assert names(tmp_path) == []


@pytest.mark.parametrize("length", ["Content-Length: {0}", "Transfer-Encoding: chunked"])
def test_an_upload_that_is_too_large_is_refused_and_removed(local, tmp_path, length):
    size = MOST_UPLOAD + 1
    body = f"{size:x}\r\n{'x' * size}\r\n0\r\n\r\n" if "chunked" in length else "x" * size
    with contextlib.suppress(ConnectionError):  # the answer comes before all is sent
        answer = local.raw(f"{SEND}{length.format(size)}\r\n\r\n{body}")
        assert not answer or (answer.startswith("HTTP/1.1 413") and "larger than 1,048,576 bytes" in answer)
    local.talk(until(lambda: names(tmp_path) == []))


def test_an_upload_that_is_broken_off_is_removed(local, tmp_path):
    with socket.create_connection(("127.0.0.1", local.server.port)) as connection:
        connection.sendall(f"{SEND}Content-Length: 1000000\r\n\r\nbegins".encode())
        local.talk(until(lambda: len(names(tmp_path)) == 1))
        assert names(tmp_path)[0].startswith(".")
    local.talk(until(lambda: names(tmp_path) == []))


def test_an_upload_ends_with_the_server(tmp_path):
    server = Running(tmp_path)
    with socket.create_connection(("127.0.0.1", server.server.port)) as connection:
        connection.sendall(f"{SEND}Content-Length: 1000000\r\n\r\nbegins".encode())
        server.talk(until(lambda: len(names(tmp_path)) == 1))
        server.close()
    assert names(tmp_path) == []


def test_few_files_arrive_at_once(local, tmp_path, monkeypatch):
    monkeypatch.setattr(server_module, "MOST_UPLOADS", 1)
    assert [local.send("a.vdb", b"data").code for _ in range(2)] == [200, 200]
    with socket.create_connection(("127.0.0.1", local.server.port)) as connection:
        connection.sendall(f"{SEND}Content-Length: 1000\r\n\r\n".encode())
        local.talk(until(lambda: len(names(tmp_path)) == 3))
        assert local.send("c.vdb", b"data").code == 503
    local.talk(until(lambda: not local.server.uploads))
    assert local.send("c.vdb", b"data").code == 200


def test_a_full_disk_is_told(local, tmp_path, monkeypatch):
    def full(*_):
        raise InputError("a.vdb: cannot be written (no room on the server's disk)")

    monkeypatch.setattr("tfm_cl.viewer.files.Upload.write", full)
    answer = local.send("a.vdb", b"data")
    assert answer.code == 507
    assert answer.body == b"a.vdb: cannot be written (no room on the server's disk)\n"
    assert names(tmp_path) == []


def test_a_taken_port_is_told_and_another_is_found(tmp_path, monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=rf"^--port {port}: is taken by another program; choose another"):
            Server(FakeSession, Files(tmp_path), port=port)
        monkeypatch.setattr(server_module, "PORT", port)
        with contextlib.closing(Server(FakeSession, Files(tmp_path))) as server:
            assert port < server.port < port + server_module.PORTS
        monkeypatch.setattr(server_module, "PORTS", 1)
        with pytest.raises(InputError, match=r"^no port from .* choose another with --port$"):
            Server(FakeSession, Files(tmp_path))


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid", "not a host"])
def test_an_address_of_another_machine_is_told(tmp_path, host):
    with pytest.raises(InputError, match=rf"^--host {host}: "):
        Server(FakeSession, Files(tmp_path), host=host, port=0)
