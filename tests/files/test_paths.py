import os
from pathlib import Path

import pytest

from tfm_cl.errors import InputError, SceneError
from tfm_cl.files.paths import check_readable, check_writable, path_of, replacing, source_of, write_text

LONGEST = 255
"""Bytes of a name in the common file systems."""


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_what_is_written_appears_at_the_end(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with replacing(target) as temporary:
        assert temporary.parent == tmp_path  # the same file system, so that renaming is atomic
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("survives", [True, False])
def test_what_is_to_survive_a_power_cut_is_flushed(tmp_path, monkeypatch, survives):
    flushed = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: flushed.append(os.fstat(descriptor).st_size))
    write_text(tmp_path / "a.txt", "new", survives_power_cuts=survives)
    assert flushed == ([3] if survives else [])
    assert (tmp_path / "a.txt").read_text() == "new"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_a_failure_the_old_file_stands(tmp_path, error):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def write_half():
        with replacing(target) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        write_half()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "folder").mkdir()
    link = tmp_path / "link.txt"
    link.symlink_to(tmp_path / "folder" / "real.txt")
    write_text(link, "π\n")
    assert link.is_symlink()
    assert (tmp_path / "folder" / "real.txt").read_bytes() == "π\n".encode()
    assert names(tmp_path / "folder") == ["real.txt"]


def test_checking_leaves_no_trace(tmp_path):
    check_writable(tmp_path / "new.txt")
    assert names(tmp_path) == []
    (tmp_path / "old.txt").write_text("old")
    check_writable(tmp_path / "old.txt")
    assert (tmp_path / "old.txt").read_text() == "old"
    assert names(tmp_path) == ["old.txt"]


@pytest.mark.parametrize(
    ("name", "message"),
    [("no/a.txt", "no/a.txt: there is no directory"), (".", "is a directory"), ("pipe", "not a plain file")],
)
def test_places_where_nothing_can_be_written(tmp_path, monkeypatch, name, message):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    with pytest.raises(SceneError, match=message):
        check_writable((tmp_path / name).relative_to(tmp_path), SceneError)
    assert names(tmp_path) == ["pipe"]


def test_a_folder_that_is_read_only(tmp_path):
    folder = tmp_path / "kept"
    folder.mkdir(mode=0o500)
    if os.access(folder, os.W_OK):
        pytest.skip("this user may write everywhere")
    for attempt in (lambda: check_writable(folder / "a.txt"), lambda: write_text(folder / "a.txt", "")):
        with pytest.raises(InputError, match="cannot be written"):
            attempt()


def test_writing_reports_what_went_wrong(tmp_path):
    with pytest.raises(InputError, match=r"a\.txt: there is no directory"):
        write_text(tmp_path / "no" / "a.txt", "")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"folder: is a directory"):
        write_text(tmp_path / "folder", "")
    assert names(tmp_path) == ["folder"]


@pytest.mark.parametrize("length", [242, 250, LONGEST])
def test_names_as_long_as_the_system_allows(tmp_path, length):
    target = tmp_path / ("a" * (length - 4) + ".txt")
    check_writable(target)
    write_text(target, "long")
    assert target.read_text() == "long"
    assert names(tmp_path) == [target.name]


@pytest.mark.parametrize("folder", [False, True])
def test_a_name_longer_than_the_system_allows(tmp_path, folder):
    path = tmp_path / ("a" * (LONGEST + 1)) / "a.txt" if folder else tmp_path / ("a" * (LONGEST + 1))
    with pytest.raises(SceneError, match=r"cannot be written \(File name too long\)"):
        check_writable(path, SceneError)
    with pytest.raises(SceneError, match=r"cannot be read \(File name too long\)"):
        check_readable(path, SceneError)


def test_a_link_to_itself(tmp_path):
    link = tmp_path / "a.txt"
    link.symlink_to(link)
    with pytest.raises(InputError, match=r"a\.txt: cannot be written \(Too many levels of symbolic links\)"):
        write_text(link, "")
    with pytest.raises(InputError, match=r"a\.txt: cannot be read \(Too many levels of symbolic links\)"):
        check_readable(link)
    assert link.is_symlink()
    assert names(tmp_path) == ["a.txt"]


def test_what_can_be_read_is_measured(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"12345")
    (tmp_path / "link").symlink_to("a.txt")
    assert check_readable(tmp_path / "a.txt") == check_readable(tmp_path / "link") == 5


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no.txt", "no.txt: no such file"),
        ("a.txt/b.txt", "b.txt: no such file"),
        ("folder", "folder: is not a file but a directory"),
        ("pipe", "pipe: is not a file but a pipe or device"),  # opening it would wait for ever
    ],
)
def test_what_cannot_be_read(tmp_path, name, message):
    (tmp_path / "a.txt").touch()
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(SceneError, match=message):
        check_readable(tmp_path / name, SceneError)


@pytest.mark.parametrize("make", [path_of, source_of])
@pytest.mark.parametrize("name", ["", "a\0.txt", "a\nb.txt", "\x1b[2J.txt", "a\x7f", "a\u2028b"])
def test_what_is_no_name(make, name):
    with pytest.raises(SceneError, match="should be the name of a file") as raised:
        make(name, error=SceneError)
    assert str(raised.value).isprintable()


@pytest.mark.parametrize("name", ["a b.txt", "at 3.45\u202fPM.png", "a\xa0b", "Wolke – é.vdb", "x\udcff.npy"])
def test_names_of_any_other_kind(name):
    assert path_of(name) == source_of(name) == Path(name)


def test_the_home_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/someone")
    for make in (path_of, source_of):
        assert make("~/a.txt") == make(Path("~/a.txt")) == Path("/home/someone/a.txt")
        assert make("a/~/b.txt") == Path("a/~/b.txt")
        assert make("~nobody-of-that-name/a.txt") == Path("~nobody-of-that-name/a.txt")
    (tmp_path / "scenes").mkdir()
    assert source_of("~/a.txt", tmp_path / "scenes") == Path("/home/someone/a.txt")


def test_what_is_called_like_a_home_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", "/home/someone")
    (tmp_path / "~").mkdir()
    assert path_of("~/a.txt") == source_of("~/a.txt") == Path("~/a.txt")
    assert source_of("~/a.txt", tmp_path / "scenes") == Path("/home/someone/a.txt")


def test_back_slashes_separate_folders_where_that_leads_to_a_file(tmp_path):
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "window.png").touch()
    name = r"textures\window.png"
    assert source_of(name, tmp_path) == tmp_path / "textures" / "window.png"
    assert source_of(r"textures\door.png", tmp_path) == tmp_path / r"textures\door.png"
    (tmp_path / name).touch()
    assert source_of(name, tmp_path) == tmp_path / name


def test_back_slashes_after_the_home_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "a.txt").touch()
    assert source_of(r"~\a.txt", tmp_path / "scenes") == tmp_path / "a.txt"
