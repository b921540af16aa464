"""What waits for a client."""

import json
import threading

import pytest

from tfm_cl.viewer.mailbox import MOST_NOTICES, Mailbox


@pytest.fixture
def ready():
    """Counts how often something was ready."""
    return []


@pytest.fixture
def mailbox(ready):
    return Mailbox(lambda: ready.append(1))


def header_of(message):
    size = int.from_bytes(message[:4], "little")
    return json.loads(message[4 : 4 + size]), message[4 + size :]


def picture(number, which="a"):
    return {"type": "picture", "picture": number, "which": which}


def test_a_picture_is_its_header_and_its_bytes(mailbox, ready):
    mailbox.put_picture(picture(1), b"pixels")

    (message,) = mailbox.take()

    assert ready
    assert header_of(message) == (picture(1), b"pixels")


def test_only_the_newest_picture_waits_until_the_last_was_seen(mailbox, ready):
    mailbox.put_picture(picture(1), b"")
    assert len(mailbox.take()) == 1
    ready.clear()
    mailbox.put_picture(picture(2), b"")
    mailbox.put_picture(picture(3), b"")
    assert (mailbox.take(), ready) == ([], [])

    mailbox.seen(2)  # not the one on its way
    assert mailbox.take() == []
    mailbox.seen(1)

    assert ready == [1]
    assert [header_of(message)[0]["picture"] for message in mailbox.take()] == [3]
    assert mailbox.take() == []


def test_pictures_of_other_kinds_wait_too(mailbox):
    mailbox.put_picture(picture(1, "a"), b"")
    mailbox.put_picture(picture(2, "b"), b"")
    mailbox.put_picture(picture(3, "a"), b"")

    shown = []
    for number in (3, 2):
        (message,) = mailbox.take()
        shown.append(header_of(message)[0]["picture"])
        mailbox.seen(number)

    assert shown == [3, 2]


def test_notices_come_in_order_before_pictures(mailbox):
    mailbox.put_picture(picture(1), b"")
    mailbox.put({"type": "saved", "path": "a.exr"})
    mailbox.put({"type": "saved", "path": "b.exr"})

    first, second, third = mailbox.take()

    assert [json.loads(first)["path"], json.loads(second)["path"]] == ["a.exr", "b.exr"]
    assert isinstance(third, bytes)


def test_of_states_only_the_newest_waits(mailbox):
    mailbox.put({"type": "state", "revision": 1})
    mailbox.put({"type": "failed", "line": "no"})
    mailbox.put({"type": "cleared"})
    mailbox.put({"type": "state", "revision": 2})

    assert [json.loads(text)["type"] for text in mailbox.take()] == ["cleared", "state"]


def test_a_client_that_takes_nothing_holds_little(mailbox):
    for number in range(2 * MOST_NOTICES):
        mailbox.put({"type": "saved", "path": str(number)})

    taken = mailbox.take()

    assert len(taken) == MOST_NOTICES
    assert json.loads(taken[-1])["path"] == str(2 * MOST_NOTICES - 1)


def test_any_thread_may_put(mailbox):
    threads = [
        threading.Thread(target=lambda: [mailbox.put({"type": "saved", "path": ""}) for _ in range(50)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(mailbox.take()) == 200


def test_numbers_that_json_lacks_are_refused(mailbox):
    with pytest.raises(ValueError, match="JSON"):
        mailbox.put({"type": "curve", "z": [float("nan")]})
