"""Frames of a film are what a PNG shows of them."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files import image_io
from tfm_cl.files.film_io.frames import Frame
from tfm_cl.files.image_io import Image, WriteOptions
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.image_io.image import Picture
from tfm_cl.sequence import film
from tfm_cl.sequence.film import PicturesFilm


def progress(_stage, _part):
    """Be told nothing."""


@pytest.fixture
def pictures(rng):
    """Three, each brighter than the one before."""
    return [
        np.concatenate([2.0**i * rng.random((6, 8, 3)), np.ones((6, 8, 1))], axis=2).astype(np.float32)
        for i in range(3)
    ]


def saved(folder, pictures, extension=".exr", **options):
    frames = [Frame(i, folder / f"a.{i:04d}{extension}") for i in range(len(pictures))]
    for frame, picture in zip(frames, pictures, strict=True):
        image_io.save(frame.path, Image(rgba=picture), pixel_type="float", **options)
    return frames


def test_exr_is_shown_as_a_png(tmp_path, pictures):
    frames = saved(tmp_path, pictures)
    saved(tmp_path, pictures, ".png", exposure=-1.5, view="agx")

    film = PicturesFilm.of(frames, WriteOptions(exposure=-1.5, view="agx"))
    shown = PicturesFilm.of([Frame(0, tmp_path / "a.0001.png")], WriteOptions())

    assert (film.codes(1) == shown.codes(0)).all()
    png = np.asarray(PIL.Image.open(tmp_path / "a.0001.png"))
    assert (shown.codes(0) == png).all()


def test_one_exposure_for_all(tmp_path, pictures):
    film = PicturesFilm.of(saved(tmp_path, pictures), WriteOptions(exposure="auto")).exposed(progress)
    assert film.options.exposure == automatic_exposure(np.concatenate(pictures), "standard")
    assert film.codes(0).mean() < film.codes(1).mean() < film.codes(2).mean()


def test_crops_lie_where_they_belong(tmp_path):
    crop = np.full((2, 3, 4), 1.0, np.float32)
    path = tmp_path / "a.exr"
    image_io.save(path, Image(rgba=crop, display_window=(8, 6), crop=(1, 2, 4, 4)))

    codes = PicturesFilm.of([Frame(1, path)], WriteOptions()).codes(0)

    assert codes.shape == (6, 8, 3)
    assert (codes[2:4, 1:4] == 255).all()
    assert codes.astype(int).sum() == 255 * crop[..., :3].size


@pytest.mark.parametrize("frame", [(0, 0, 1 << 20, 1 << 20), (8, 8, 0, 0)])
def test_frames_that_cannot_be_are_refused(monkeypatch, frame):
    picture = Picture(np.ones((2, 2, 3), np.float32), window=(0, 0, 2, 2), frame=frame)
    monkeypatch.setattr(film, "load_picture", lambda _path: picture)
    with pytest.raises(ImageError, match=r"a\.exr: declares a full frame of .* pixels; it is damaged"):
        PicturesFilm.of([Frame(1, Path("a.exr"))], WriteOptions())


def test_width(tmp_path, pictures):
    film = PicturesFilm.of(saved(tmp_path, pictures), WriteOptions(), 4)
    assert film.size == (4, 3)
    assert film.codes(0).shape == (3, 4, 3)


def test_other_sizes_and_what_is_no_number_are_refused(tmp_path, pictures):
    frames = saved(tmp_path, [pictures[0], pictures[1][:5]])
    film = PicturesFilm.of(frames, WriteOptions())
    with pytest.raises(ImageError, match=r"a\.0001\.exr: is 8×5 pixels, and .*a\.0000\.exr is 8×6; "):
        film.codes(1)
    np.save(tmp_path / "a.npy", np.full((6, 8, 4), np.nan, np.float32))
    film = PicturesFilm.of([Frame(1, tmp_path / "a.npy")], WriteOptions())
    with pytest.raises(ImageError, match=r"a\.npy: holds 192 values that are NaN"):
        film.codes(0)
    with pytest.raises(ImageError, match=r"b\.exr: no such file"):
        PicturesFilm.of([Frame(1, Path("b.exr"))], WriteOptions())
