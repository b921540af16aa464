"""The viewer's web server: the page, its messages and uploads, for nobody but that page."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import hmac
import ipaddress
import os
import re
import secrets
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tfm_cl.errors import InputError
from tfm_cl.extras import needs
from tfm_cl.files.paths import reason_of
from tfm_cl.viewer.clients import failed
from tfm_cl.viewer.files import Files, Upload, break_off, kind_of, too_large
from tfm_cl.viewer.mailbox import Mailbox
from tfm_cl.viewer.messages import MOST_BYTES, parsed
from tfm_cl.viewer.page import document

if TYPE_CHECKING:
    from tfm_cl.viewer.session import Session

with needs("view", "the viewer", InputError):
    from tornado import httpserver, iostream, web, websocket

LOOPBACK = "127.0.0.1"
PORT = 8090
"""Tried first."""
PORTS = 100
"""That are tried, from there on."""
BACKLOG = 128
"""Connections that may wait to be answered."""
MOST_CLIENTS = 64
MOST_UPLOADS = 8
"""At once."""
KEPT = 600.0
"""Seconds for which the session of a client that has gone is kept: the page may be loaded again."""
MOST_KEPT = 8
"""Such sessions."""
MOST_FAULTS = 100
"""Messages that are none, after which a client is let go."""
PING = 30.0
"""Seconds between two pings, and within which an answer must come; a large picture may be before it."""
ENDED_WITHIN = 0.5
"""Seconds that connections have to end in good order."""
IDLE = 60.0
"""Seconds after which a connection that asks nothing is closed."""
MOST_HEADER = 16 << 10
"""Bytes of a request's headers."""
CHUNK = 1 << 18
"""Bytes of an upload that are read at once."""
_KEY = re.compile(r"[A-Za-z0-9_-]{16,64}")
"""Made up by a page, which finds its session again by it."""
_HOST = re.compile(r"(?P<name>[a-z0-9._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?")


@dataclass
class _Kept:
    """A session, how many see it, and when the last one left."""

    session: Session
    clients: int = 0
    left: float = 0.0


class Server:
    """Serves the page, and brings messages to sessions and back.

    It listens from the start, and answers while `run` runs.

    Parameters
    ----------
    new_session
        Makes what a client sees.
    files
        Where uploads go.
    host
        Address to listen at; None: this machine only, without a token.
    port
        To listen at; None: the first that is free from `PORT` on; 0: any.
    shared
        All clients see one session.

    Raises
    ------
    InputError
        It cannot listen there.
    """

    def __init__(
        self,
        new_session: Callable[[], Session],
        files: Files,
        *,
        host: str | None = None,
        port: int | None = None,
        shared: bool = False,
    ) -> None:
        self.files = files
        self.token = None if host is None else secrets.token_urlsafe(32)
        """What whoever opens the page has to show; None: nothing."""
        self.sockets: set[_Socket] = set()
        """Of the clients."""
        self.uploads: set[_Uploads] = set()
        """That are under way."""
        self._new_session, self._shared, self._host = new_session, shared, host
        self._sessions: dict[str, _Kept] = {}
        self._listening = _listen(host or LOOPBACK, port)
        self._listening.settimeout(0)  # tornado waits for it
        self.port: int = self._listening.getsockname()[1]
        self._stop: Callable[[], None] | None = None
        self._is_stopped = False

    @property
    def address(self) -> str:
        """What a browser is to open."""
        name = self._host or LOOPBACK
        if _is_any(name):
            name = socket.gethostname()
        shown = f"[{name}]" if ":" in name else name
        return f"http://{shown}:{self.port}/" + ("" if self.token is None else f"?token={self.token}")

    @property
    def cookie(self) -> str:
        """Name of the cookie that keeps the token: browsers send cookies to all ports of a host."""
        return f"tfm_view_{self.port}"

    def run(self) -> None:
        """Serve until `stop`."""
        asyncio.run(self._serve())

    def stop(self) -> None:
        """End `run`, from any thread; clients are told."""
        self._is_stopped = True
        if self._stop is not None:
            self._stop()

    def close(self) -> None:
        """Listen no more."""
        self._listening.close()

    async def _serve(self) -> None:
        loop, stopped = asyncio.get_running_loop(), asyncio.Event()

        def stop() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended already
                loop.call_soon_threadsafe(stopped.set)

        self._stop = stop
        application = web.Application(
            [(r"/", _Page), (r"/socket", _Socket), (r"/upload", _Uploads), (r"/favicon\.ico", _NoIcon)],
            default_handler_class=_Nothing,
            log_function=lambda _: None,
            websocket_max_message_size=MOST_BYTES,
            websocket_ping_interval=PING,
            websocket_ping_timeout=PING,
            server=self,
        )
        http = httpserver.HTTPServer(
            application,
            idle_connection_timeout=IDLE,
            max_header_size=MOST_HEADER,
            max_body_size=MOST_HEADER,  # uploads have a limit of their own
            chunk_size=CHUNK,
        )
        http.add_sockets([self._listening])
        if self._is_stopped:
            stopped.set()
        try:
            await stopped.wait()
        finally:
            http.stop()
            for client in list(self.sockets):
                client.close(1001, "the viewer has ended")
            await asyncio.sleep(0)  # until that is sent
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(http.close_all_connections(), ENDED_WITHIN)

    def is_ours(self, host: str) -> bool:
        """Tell whether a request's ``Host`` names this server; the port may be another, of a tunnel.

        Any other name may be one that somebody else's page had lead here, and be that page's own. Numbers
        cannot be made to lead anywhere else.
        """
        found = _HOST.fullmatch(host.lower())
        if found is None:
            return False
        name = found["name"]
        address = _address(name)
        if address is not None:
            return self._host is not None or bool(address.is_loopback)
        return name in {"localhost", *_names(self._host)}

    def is_token(self, given: str | None) -> bool:
        """Tell whether a token is the right one."""
        return self.token is None or hmac.compare_digest((given or "").encode(), self.token.encode())

    def join(self, key: str | None) -> tuple[str, Session]:
        """Return a client's session and the name under which it is kept; ``key`` is one from before."""
        self._forget()
        name = "all" if self._shared else key or secrets.token_urlsafe(16)
        kept = self._sessions.get(name) or self._sessions.setdefault(name, _Kept(self._new_session()))
        kept.clients += 1
        return name, kept.session

    def leave(self, name: str) -> None:
        """Keep the session of a client that has gone, and may come back."""
        kept = self._sessions[name]
        kept.clients -= 1
        kept.left = time.monotonic()
        self._forget()

    def _forget(self) -> None:
        """Drop sessions that nobody has seen for long, and the oldest where there are too many."""
        unseen = sorted((kept.left, name) for name, kept in self._sessions.items() if not kept.clients)
        now = time.monotonic()
        for more, (left, name) in enumerate(reversed(unseen)):
            if more >= MOST_KEPT or now - left > KEPT:
                del self._sessions[name]


class _RefusedError(web.HTTPError):
    """A request that is refused, and why."""

    def __init__(self, status: int, line: str) -> None:
        super().__init__(status)
        self.line = line


class _Checked(web.RequestHandler):
    """A request of nobody but our own page."""

    NEEDS_ORIGIN = False
    """Whether the page itself has to ask; what a link leads to is asked for by no page."""

    @property
    def server(self) -> Server:
        """The server."""
        server: Server = self.settings["server"]
        return server

    def set_default_headers(self) -> None:
        """Have browsers keep, guess and lend nothing."""
        self.clear_header("Server")
        for name, value in {
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
        }.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse what is not for us, or of another page, or without the token."""
        hosts, origins = (self.request.headers.get_list(name) for name in ("Host", "Origin"))
        if len(hosts) != 1 or not self.server.is_ours(hosts[0]):
            raise _RefusedError(403, "the viewer has another name: open the address that was printed")
        if (origins or self.NEEDS_ORIGIN) and origins != [f"http://{hosts[0]}"]:
            raise _RefusedError(403, "another page asks, and only the viewer's own may")
        if not self.is_known():
            raise _RefusedError(403, "the token is missing or wrong: open the address that was printed")

    def is_known(self) -> bool:
        """Tell whether the client has shown the token before."""
        return self.server.is_token(self.get_cookie(self.server.cookie))

    def compute_etag(self) -> None:
        """Name no version: nothing is kept."""

    def write_error(self, status_code: int, **info: Any) -> None:
        """Say in a line what is wrong."""
        del status_code
        error = info.get("exc_info", (None, None, None))[1]
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{getattr(error, 'line', self._reason)}\n")


class _Nothing(_Checked):
    """Whatever else is asked for."""

    def prepare(self) -> None:
        """Refuse it."""
        super().prepare()
        raise _RefusedError(404, "there is nothing here: the viewer is one page, /")


class _NoIcon(_Checked):
    """The icon that browsers ask for by themselves."""

    def get(self) -> None:
        """Have none, which is no error."""
        self.set_status(204)


class _Page(_Checked):
    """The page."""

    def is_known(self) -> bool:
        """Tell whether the client shows the token, or has shown it before."""
        given = self.get_query_arguments("token")
        return super().is_known() or (len(given) == 1 and self.server.is_token(given[0]))

    def get(self) -> None:
        """Send it, with the token where scripts and other sites do not see it."""
        server, page = self.server, document()
        if server.token is not None:
            self.set_cookie(server.cookie, server.token, path="/", httponly=True, samesite="Strict")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header(
            "Content-Security-Policy",
            f"default-src 'none'; script-src {page.script_hash}; style-src {page.style_hash}; "
            f"connect-src 'self' ws://{self.request.headers['Host']}; img-src 'self' data: blob:; "
            "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
        )
        self.finish(page.text)


@web.stream_request_body
class _Uploads(_Checked):
    """A file that the page sends."""

    NEEDS_ORIGIN = True
    _upload: Upload | None = None

    def initialize(self) -> None:
        """Nothing is open yet."""
        self._open = contextlib.ExitStack()

    def prepare(self) -> None:
        """Begin to write it."""
        super().prepare()
        if self.request.method != "POST":
            raise _RefusedError(405, "files are sent by POST")
        if len(self.server.uploads) >= MOST_UPLOADS:
            raise _RefusedError(503, f"{MOST_UPLOADS} files are being sent; wait until one of them is there")
        # As they are: `get_query_arguments` would take letters away.
        files, names = self.server.files, self.request.query_arguments.get("name", [])
        if len(names) != 1:
            raise _RefusedError(400, "a file needs a name: /upload?name=cloud.vdb")
        name = names[0].decode(errors="replace")
        said = self.request.query_arguments.get("kind", [b"scene"])
        try:
            kind = kind_of(" ".join(one.decode(errors="replace") for one in said))
        except InputError as error:
            raise _RefusedError(400, str(error)) from None
        most = files.most_of(kind)
        length = self.request.headers.get("Content-Length", "")
        if length.isdecimal() and int(length) > most:
            raise _RefusedError(413, str(too_large(name, most)))
        # The upload itself refuses what is more, in a line.
        self.request.connection.set_max_body_size(most + CHUNK)  # type: ignore[union-attr]
        with self._refusing():
            self.server.uploads.add(self)
            self._upload = self._open.enter_context(files.upload(name, kind))

    async def data_received(self, chunk: bytes) -> None:
        """Add a part."""
        upload = self._upload
        if upload is None:
            return
        try:
            await asyncio.to_thread(upload.write, chunk)
        except InputError as error:
            self._break_off()
            self.set_status(413 if upload.size > upload.most else 507)
            self.set_header("Content-Type", "text/plain; charset=utf-8")
            self.finish(f"{error}\n")
        except ValueError:  # it was broken off meanwhile, and its file closed
            if self._upload is not None:
                raise

    async def post(self) -> None:
        """Put the whole file where it can be opened."""
        upload = self._upload
        if upload is None or self._finished:
            return
        with self._refusing():
            await asyncio.to_thread(self._open.close)  # which waits for the disk
        self.finish({"path": upload.name})

    def on_connection_close(self) -> None:
        """Remove what is there of a file whose sender has gone."""
        self._break_off()

    def on_finish(self) -> None:
        """Remove what is there of a file that was refused."""
        self._break_off()

    def _break_off(self) -> None:
        self.server.uploads.discard(self)
        self._upload = None
        break_off(self._open)

    @contextlib.contextmanager
    def _refusing(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            raise _RefusedError(400, str(error)) from None


class _Socket(_Checked, websocket.WebSocketHandler):
    """A client: what its page says, and what it is told."""

    NEEDS_ORIGIN = True
    _faults = 0
    _is_sending = False
    _name: str | None = None

    def prepare(self) -> None:
        """Refuse one client too many."""
        super().prepare()
        if len(self.server.sockets) >= MOST_CLIENTS:
            raise _RefusedError(503, f"{MOST_CLIENTS} clients are connected; close one of them")

    def check_origin(self, origin: str) -> bool:
        """Tell whether the page that asks is ours."""
        return origin == f"http://{self.request.headers['Host']}"

    def open(self, *_: str, **__: str) -> None:
        """Show the client a session: its own, or that of all."""
        self.set_nodelay(True)
        self._loop = asyncio.get_running_loop()
        self._mailbox = Mailbox(self._wake)
        keys = [key for key in self.get_query_arguments("session") if _KEY.fullmatch(key)]
        self.server.sockets.add(self)
        self._name, self._session = self.server.join(keys[0] if keys else None)
        self._session.join(self._mailbox)

    def on_message(self, message: str | bytes) -> None:
        """Do what the page says."""
        try:
            if isinstance(message, bytes):
                raise InputError("a message should be text; files are sent to /upload")  # noqa: TRY301
            said = parsed(message)
        except InputError as error:
            self._faults += 1
            self._mailbox.put(failed(error))
            if self._faults >= MOST_FAULTS:
                self.close(1008, "too many messages that are none")
            return
        self._session.say(said, self._mailbox)

    def on_close(self) -> None:
        """Show the session to one client less."""
        self.server.sockets.discard(self)
        if self._name is not None:
            self._session.leave(self._mailbox)
            self.server.leave(self._name)

    def _wake(self) -> None:
        """Send what waits, from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._begin_to_send)

    def _begin_to_send(self) -> None:
        if not self._is_sending:
            self._is_sending = True
            self._task = asyncio.create_task(self._send())

    async def _send(self) -> None:
        """Send what waits, no faster than the client takes it: others do not wait for that."""
        try:
            while messages := self._mailbox.take():
                for message in messages:
                    await self.write_message(message, binary=isinstance(message, bytes))
        except (websocket.WebSocketClosedError, iostream.StreamClosedError):
            pass
        finally:
            self._is_sending = False


def _listen(host: str, port: int | None) -> socket.socket:
    """Listen at a port, or at the first that is free."""
    for candidate in range(PORT, PORT + PORTS) if port is None else (port,):
        try:
            found = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
            family, *_, address = min(found, key=lambda info: info[0] != socket.AF_INET)
            return socket.create_server(address[:2], family=family, backlog=BACKLOG)
        except (socket.gaierror, UnicodeError) as problem:
            raise InputError(f"--host {host}: is no address of this machine ({reason_of(problem)})") from None
        except OSError as problem:
            if problem.errno == errno.EADDRINUSE:
                continue
            if problem.errno == errno.EACCES:
                few = "the system gives this port to few programs"
                raise InputError(f"--port {candidate}: {few}; choose one from 1024 on") from None
            reason = os.strerror(problem.errno or 0)
            raise InputError(f"--host {host}: cannot be listened at ({reason})") from None
    if port is None:
        raise InputError(f"no port from {PORT} to {PORT + PORTS - 1} is free; choose another with --port")
    raise InputError(f"--port {port}: is taken by another program; choose another, or leave --port out")


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Read an address in numbers; None of a name."""
    try:
        return ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return None


def _is_any(host: str) -> bool:
    """Tell whether a host means all addresses of this machine."""
    address = _address(host)
    return address is not None and address.is_unspecified


def _names(host: str | None) -> set[str]:
    """Return the names, in small letters, of what is listened at."""
    if host is None:
        return set()
    own = socket.gethostname().lower()
    return {own, own.partition(".")[0] + ".local"} if _is_any(host) else {host.lower()}
