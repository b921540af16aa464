import os

import pytest

from tfm_cl.errors import InputError, SceneError
from tfm_cl.files import check_writable, replacing, write_text


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
