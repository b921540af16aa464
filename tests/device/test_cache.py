"""The session's cache: what is kept, and for how long."""

import numpy as np
import pytest

from tfm_cl.device.cache import Cache, Same


def made(cache, key, size=1, kind="map"):
    """Ask for a value that says which making it was."""
    return cache.get(kind, key, object, lambda _: size)


def test_what_is_kept_is_not_made_again():
    cache = Cache(10)
    assert made(cache, "a") is made(cache, "a")
    assert made(cache, "a") is not made(cache, "b")
    assert cache.made == {"map": 2}


def test_what_does_not_serve_is_made_again():
    cache = Cache(10)
    first = made(cache, "a", 4)
    again = cache.get("map", "a", object, lambda _: 5, serves=lambda kept: kept is not first)
    assert again is not first
    assert cache.nbytes == 5
    assert cache.get("map", "a", object, lambda _: 5, serves=lambda kept: kept is again) is again


def test_kinds_do_not_share_keys():
    cache = Cache(10)
    assert made(cache, "a", kind="map") is not made(cache, "a", kind="bricks")


def test_the_least_recently_used_goes_first():
    cache = Cache(3)
    first, second = made(cache, "first"), made(cache, "second")
    assert made(cache, "first") is first  # which is the more recent one now
    made(cache, "large", 2)
    assert cache.nbytes == 3
    assert made(cache, "first") is first
    assert made(cache, "second") is not second


@pytest.mark.parametrize("budget", [0, 3])
def test_the_latest_stays_whatever_its_size(budget):
    cache = Cache(budget)
    made(cache, "small")
    large = made(cache, "large", 100)
    assert made(cache, "large", 100) is large
    assert cache.nbytes == 100


def test_what_is_held_is_not_pushed_out():
    cache = Cache(10)

    def held(key):
        return cache.get("bricks", key, object, lambda _: 9, held=True)

    first = held("first")
    maps = [made(cache, number, 2) for number in range(3)]
    assert held("first") is first
    assert made(cache, 2, 2) is maps[2]
    assert cache.nbytes == 11
    held("second")  # so that nothing holds the first any more
    assert cache.nbytes == 9
    assert held("first") is not first


def test_what_fails_is_not_kept():
    cache = Cache(10)

    def fail():
        raise MemoryError

    with pytest.raises(MemoryError):
        cache.get("map", "a", fail, lambda _: 1)
    assert cache.nbytes == 0
    assert made(cache, "a") is made(cache, "a")


def test_nothing_is_left_when_it_is_cleared():
    cache = Cache(10)
    before = made(cache, "a")
    cache.clear()
    assert cache.nbytes == 0
    assert made(cache, "a") is not before


def made_together(cache, keys, size=1):
    """Ask for many values; returns them and the keys that were made."""
    asked = []

    def make(places):
        asked.extend(keys[place] for place in places)
        return [object() for _ in places]

    return cache.get_many("map", keys, make, lambda _: size), asked


def test_of_many_only_those_that_are_missing_are_made():
    cache = Cache(10)
    kept = made(cache, "b")
    values, asked = made_together(cache, ["a", "b", "c", "a"])
    assert asked == ["a", "c"]
    assert values[1] is kept
    assert values[0] is values[3] is not values[2]
    assert made_together(cache, ["c", "a"]) == ([values[2], values[0]], [])
    assert cache.nbytes == cache.made["map"] == 3


def test_many_values_may_push_each_other_out():
    cache = Cache(2)
    first, second = made(cache, "first"), made(cache, "second")
    values, asked = made_together(cache, ["new", "first", "newer", "second"])
    assert asked == ["new", "newer"]
    assert values[1] is first
    assert values[3] is second
    assert cache.nbytes == 2


def test_same_is_known_by_being_itself():
    first, second = np.zeros(2), np.zeros(2)
    cache = Cache()
    found = [cache.get("image", Same(image), object, lambda _: 1) for image in (first, second, first)]
    assert found[0] is found[2] is not found[1]
    assert Same(None) == Same(None)
    assert Same(first) != first


def test_what_two_frames_had_no_use_for_is_forgotten():
    cache = Cache(100)
    old, still = made(cache, "old"), made(cache, "still")
    for frame in range(3):
        made(cache, frame)
        assert made(cache, "still") is still
        cache.forget_unused()
    assert cache.nbytes == 3  # of the last two frames, and what all have
    assert made(cache, "old") is not old
    assert made(cache, "still") is still
