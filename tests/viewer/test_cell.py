"""The widget's messages, without a kernel and with a session that only listens."""

import asyncio
import json
import threading

import pytest

from tfm_cl.errors import InputError
from tfm_cl.viewer.cell import MOST_VIEWS, SILENT, Shown, Viewer
from tfm_cl.viewer.files import Files
from tfm_cl.viewer.messages import Seen, Undo

KEY, OTHER = "0" * 32, "f" * 32


class Listening:
    """A session that keeps what it is told, and tells those who join what it has."""

    def __init__(self):
        self.said, self.mailboxes = [], []

    def say(self, said, mailbox=None):
        if isinstance(said, Seen):
            mailbox.seen(said.picture)
        else:
            self.said.append((said, mailbox))

    def join(self, mailbox):
        self.mailboxes.append(mailbox)
        mailbox.put({"type": "welcome"})
        mailbox.put_picture({"which": "a", "picture": 1}, b"pixels")

    def leave(self, mailbox):
        self.mailboxes.remove(mailbox)


@pytest.fixture
def session():
    return Listening()


@pytest.fixture
def released():
    return []


@pytest.fixture
def viewer(session, released, tmp_path):
    shown = Shown(session, Files(tmp_path), lambda: "the scene", lambda: released.append(1))
    with Viewer(shown) as viewer:
        viewer.sent = []
        viewer.send = lambda content, buffers=None: viewer.sent.append((content, buffers))
        yield viewer


def say(viewer, key=KEY, buffers=(), **content):
    """A view's message, as the kernel hands it over."""
    viewer._handle_custom_msg({"view": key, **content}, list(buffers))


def texts(viewer, key=KEY):
    return [
        json.loads(content["text"])
        for content, _ in viewer.sent
        if content == {**content, "view": key} and "text" in content
    ]


def test_a_view_is_shown_the_session_until_it_goes(viewer, session):
    say(viewer, here=True)

    assert texts(viewer) == [{"type": "welcome"}]
    (picture,) = [buffers for _, buffers in viewer.sent if buffers]
    assert picture[0].endswith(b"pixels")
    assert viewer.sent[-1] == ({"view": KEY, "here": True}, None)
    say(viewer, OTHER, here=True)
    assert len(session.mailboxes) == 2
    for key in (KEY, OTHER, OTHER):
        say(viewer, key, gone=True)
    assert session.mailboxes == []


def test_what_a_view_says_reaches_the_session_with_its_mailbox(viewer, session):
    say(viewer, said='{"type": "undo"}')
    say(viewer, said='{"type": "undu"}')

    assert session.said == [(Undo(), session.mailboxes[0])]
    assert texts(viewer)[-1]["type"] == "failed"


def test_one_picture_at_a_time_is_on_its_way(viewer, session):
    say(viewer, here=True)
    session.mailboxes[0].put_picture({"which": "a", "picture": 2}, b"second")

    def pictures():
        return [buffers[0][-6:] for _, buffers in viewer.sent if buffers]

    assert pictures() == [b"pixels"]
    say(viewer, said='{"type": "seen", "picture": 1}')
    assert pictures() == [b"pixels", b"second"]
    assert session.said == []


@pytest.mark.parametrize("content", [None, [], {}, {"view": 3}, {"view": "x"}, {"view": KEY[1:]}])
def test_what_no_view_says_is_left_alone(viewer, session, content):
    viewer._handle_custom_msg(content, [])

    assert session.mailboxes == viewer.sent == []


def test_views_are_not_without_number(viewer, session):
    for number in range(MOST_VIEWS + 1):
        say(viewer, f"{number:032x}", here=True)

    assert len(session.mailboxes) == MOST_VIEWS


def test_messages_are_sent_where_those_of_the_view_are_handled(viewer, session):
    """In a kernel's event loop, whichever thread has something to tell."""
    threads = []

    async def kernel():
        say(viewer, here=True)
        viewer.send = lambda *_: threads.append(threading.current_thread())
        telling = threading.Thread(target=session.mailboxes[0].put, args=({"type": "state"},))
        telling.start()
        await asyncio.to_thread(telling.join)
        await asyncio.sleep(0.01)
        assert viewer._views[KEY].silence.when() > asyncio.get_running_loop().time() + SILENT / 2

    asyncio.run(kernel())
    assert threads
    assert set(threads) == {threading.current_thread()}
    session.mailboxes[0].put({"type": "state"})  # the loop has ended, and nobody is told


def test_a_silent_view_is_taken_for_gone(viewer, session, monkeypatch):
    monkeypatch.setattr("tfm_cl.viewer.cell.SILENT", 0.01)

    async def kernel():
        say(viewer, here=True)
        await asyncio.sleep(0.1)
        assert session.mailboxes == []
        say(viewer, here=True)
        assert len(session.mailboxes) == 1

    asyncio.run(kernel())


def test_a_file_arrives_in_parts(viewer, tmp_path):
    say(viewer, upload="cloud.vdb", isFirst=True, isLast=False, buffers=[memoryview(b"abc")])
    assert list(tmp_path.glob("*.vdb")) == []
    say(viewer, upload="cloud.vdb", isFirst=False, isLast=True, buffers=[memoryview(b"def")])

    assert [content["taken"] for content, _ in viewer.sent if "taken" in content] == [
        {},
        {"path": "cloud.vdb"},
    ]
    assert (tmp_path / "cloud.vdb").read_bytes() == b"abcdef"


def test_a_table_of_a_phase_function_arrives_as_one(viewer, tmp_path):
    for kind in ("mesh", "scene", "phase"):
        say(viewer, upload="cloud.txt", kind=kind, isFirst=True, isLast=True, buffers=[b"-1 1"])

    unknown, line, path = (content["taken"] for content, _ in viewer.sent if "taken" in content)
    assert unknown == {"line": "a file is of one kind: scene or phase"}
    assert "is no scene and no volume" in line["line"]
    assert path == {"path": "cloud.txt"}
    assert (tmp_path / "cloud.txt").read_bytes() == b"-1 1"


@pytest.mark.parametrize(
    ("name", "first", "line"),
    [
        ("../cloud.vdb", True, "../cloud.vdb: should be a plain name, without folders"),
        ("cloud.exe", True, "cloud.exe: is no scene and no volume"),
        ("cloud.vdb", False, "the file was broken off; send it again"),
    ],
)
def test_what_is_no_file_is_refused_in_a_line(viewer, tmp_path, name, first, line):
    say(viewer, upload=name, isFirst=first, isLast=True, buffers=[b"abc"])

    assert (
        viewer.sent[-1][0]["taken"]["line"].startswith(line)
        or "leads out" in viewer.sent[-1][0]["taken"]["line"]
    )
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_broken_off_is_not_there(viewer, tmp_path):
    say(viewer, upload="cloud.vdb", isFirst=True, isLast=False, buffers=[b"abc"])
    say(viewer, gone=True)

    assert list(tmp_path.iterdir()) == []


def test_closing_lets_go(viewer, session, released):
    say(viewer, here=True)
    assert viewer.scene == "the scene"
    viewer.close()
    viewer.close()

    assert (session.mailboxes, released) == ([], [1])
    say(viewer, here=True)
    assert session.mailboxes == []
    with pytest.raises(InputError, match=r"^the viewer is closed"):
        _ = viewer.scene


def test_the_page_is_a_module_that_loads_nothing(viewer):
    assert "export default" in viewer._esm
    assert "import " not in viewer._esm.replace("import nothing", "")
    assert not [word for word in ("http://", "https://", "@import", "url(") if word in viewer._css]
