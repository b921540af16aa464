import errno
import tracemalloc

import numpy as np
import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import Image, WriteOptions, load_image, npy, save


def test_round_trip_to_the_bit(tmp_path):
    bits = np.random.default_rng(0).integers(0, 0x7F80_0000, (5, 7, 4), np.uint32)
    save(tmp_path / "a.npy", Image(rgba=bits.view(np.float32)))
    stored = np.load(tmp_path / "a.npy")
    assert (stored.dtype, stored.shape) == (np.dtype("<f4"), (5, 7, 4))
    assert stored.tobytes() == bits.tobytes()
    assert load_image(tmp_path / "a.npy").tobytes() == bits.tobytes()


def test_what_does_not_fit_is_told_with_its_cause(tmp_path):
    """By which a sequence knows whether to try the next frame."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        with pytest.raises(OSError, match="too large") as raised:
            npy.write(tmp_path / "a.npy", Image(rgba=np.zeros((64, 64, 4), np.float32)), WriteOptions())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert raised.value.errno == errno.EFBIG


@pytest.mark.parametrize("dtype", [">f8", "<f2", "u1", ">i4"])
@pytest.mark.parametrize("channels", [3, 4])
def test_other_arrays_of_numbers(tmp_path, dtype, channels):
    data = np.arange(6 * channels).reshape(2, 3, channels)
    np.save(tmp_path / "a.npy", np.asfortranarray(data.astype(dtype)))
    loaded = load_image(tmp_path / "a.npy")
    assert loaded.dtype == np.float32
    assert loaded.flags.c_contiguous
    np.testing.assert_array_equal(loaded, data)


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((2, 3)),
        np.zeros((2, 3, 2)),
        np.zeros((0, 3, 4)),
        np.zeros((2, 3, 4), np.complex64),
        np.full((2, 3, 4), None),
    ],
)
def test_what_is_no_image(tmp_path, array):
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(ImageError, match=r"\[height, width, 3 or 4\] of numbers"):
        load_image(tmp_path / "a.npy")


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("the pickle was loaded",))


def test_pickles_are_never_loaded(tmp_path):
    np.save(tmp_path / "a.npy", np.full((2, 2, 4), Trap(), dtype=object), allow_pickle=True)
    with pytest.raises(ImageError, match="of numbers"):
        load_image(tmp_path / "a.npy")


@pytest.mark.parametrize("shape", ["(9999, 9999, 4)", "(99999, 99999, 4)", "(2, 3, 4,", "(-1, 1, 4)"])
def test_declared_size_is_checked(tmp_path, shape):
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    start = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little")
    (tmp_path / "a.npy").write_bytes(start + header + bytes(96))
    tracemalloc.start()
    with pytest.raises(ImageError, match=r"a\.npy"):
        load_image(tmp_path / "a.npy")
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_truncation(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((2, 3, 4), np.float32))
    sound = (tmp_path / "a.npy").read_bytes()
    for length in range(len(sound)):
        (tmp_path / "a.npy").write_bytes(sound[:length])
        with pytest.raises(ImageError):
            load_image(tmp_path / "a.npy")
