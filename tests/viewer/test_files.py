"""What a page may see of the disk: one folder, and nothing that leads out of it."""

import os

import pytest

from tfm_cl.errors import InputError
from tfm_cl.files.phase_table import MAX_BYTES
from tfm_cl.sequence.shot import Shot
from tfm_cl.viewer.files import MOST_NAME, Files

links = pytest.mark.skipif(os.name == "nt", reason="links need rights there")


@pytest.fixture
def folder(tmp_path):
    """A folder with a scene, a volume in a folder and other files, beside one that is nobody's business."""
    inner = tmp_path / "folder"
    (inner / "smoke").mkdir(parents=True)
    for name in ("a.toml", "B.vdb", "smoke/c.npy", "notes.txt", ".hidden.vdb"):
        (inner / name).write_bytes(b"data")
    (tmp_path / "folder-2").mkdir()
    for name in ("secret.vdb", "folder-2/secret.vdb"):
        (tmp_path / name).write_bytes(b"secret")
    return inner


@pytest.fixture
def files(folder):
    return Files(folder, most_upload=1000)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


OUTSIDE = (
    *("..", "../secret.vdb", "smoke/../../secret.vdb", "smoke/../a.toml", "./a.toml", "smoke//c.npy"),
    *("/etc/passwd", "//server/a.vdb", "../folder-2/secret.vdb", "", "/"),
)
ELSEWHERE = (
    *(
        "..\\secret.vdb",
        "C:\\a.vdb",
        "C:a.vdb",
        "a.vdb:stream",
        "smoke\\c.npy",
        "con.vdb",
        "NUL",
        "Lpt1.toml",
    ),
    *("COM¹.vdb", "a.vdb.", "a.vdb ", "a?.vdb", "smoke./c.npy", "aux .vdb", "conin$"),
)
"""What these mean on Windows is no file of the folder."""
NO_NAMES = ("a\0.vdb", "a\n.vdb", "\x1b[2J.vdb", "\udcff.vdb", "x" * 5000, ".hidden.vdb", "smoke/.c.npy")


def refusal(ask):
    """Return the line with which something is refused."""
    with pytest.raises(InputError) as error:
        ask()
    line = str(error.value)
    assert line.isprintable()
    assert len(line) < 2 * MOST_NAME + 100
    return line


def upload(files, name, *chunks, kind="scene"):
    with files.upload(name, kind) as open_:
        for chunk in chunks:
            open_.write(chunk)
    return open_.name


@pytest.mark.parametrize("name", [*OUTSIDE, *ELSEWHERE, *NO_NAMES])
def test_names_that_lead_elsewhere_are_refused(files, folder, name):
    before = names(folder), names(folder.parent)
    refusal(lambda: files.inside(name))
    refusal(lambda: files.opened(name))
    refusal(lambda: upload(files, name, b"data"))
    if not name.endswith((".", " ")):  # with an extension these are names like any other
        refusal(lambda: files.saved(name, ".exr"))
    if name.strip("/"):
        refusal(lambda: files.listing(name))
    assert (names(folder), names(folder.parent)) == before


def test_a_missing_name_is_told(files):
    assert "name is empty" in refusal(lambda: files.saved("", ".toml"))
    assert "name is empty" in refusal(lambda: files.opened(""))


@links
def test_links_may_not_lead_out(files, folder):
    (folder / "out.vdb").symlink_to(folder.parent / "secret.vdb")
    (folder / "up").symlink_to(folder.parent)
    (folder / "twin").symlink_to(folder.parent / "folder-2")
    (folder / "in.vdb").symlink_to(folder / "B.vdb")
    (folder / "nowhere.exr").symlink_to(folder.parent / "made.exr")
    (folder / "loop.vdb").symlink_to(folder / "loop.vdb")

    for name in ("out.vdb", "up/secret.vdb", "twin/secret.vdb"):
        assert "leads out" in refusal(lambda name=name: files.opened(name))
    for name in ("up/new", "twin/new"):
        refusal(lambda name=name: files.saved(name, ".exr"))
    assert "there already" in refusal(lambda: files.saved("nowhere", ".exr"))
    refusal(lambda: files.opened("loop.vdb"))
    refusal(lambda: files.listing("up"))
    assert files.opened("in.vdb") == (folder / "B.vdb").resolve()
    assert files.listing("")["files"] == ["a.toml", "B.vdb", "in.vdb"]
    assert upload(files, "out.vdb", b"data") == "out-2.vdb"
    assert (folder.parent / "secret.vdb").read_bytes() == b"secret"


def test_a_listing_has_what_can_be_opened(files):
    told = {"type": "listing", "kind": "scene"}
    assert files.listing("") == told | {"path": "", "folders": ["smoke"], "files": ["a.toml", "B.vdb"]}
    assert files.listing("smoke/") == told | {"path": "smoke", "folders": [], "files": ["c.npy"]}


def test_tables_of_phase_functions_are_listed_and_sent(files, folder):
    told = {"type": "listing", "kind": "phase", "path": ""}
    assert files.listing("", "phase") == told | {"folders": ["smoke"], "files": ["notes.txt"]}
    assert upload(files, "notes.txt", b"-1 1", kind="phase") == "notes-2.txt"
    assert files.listing("", "phase")["files"] == ["notes-2.txt", "notes.txt"]
    refused = refusal(lambda: upload(files, "cloud.vdb", b"data", kind="phase"))
    assert refused == "cloud.vdb: is no table of a phase function; known: .csv .dat .tsv .txt"
    assert files.most_of("phase") == 1000
    assert Files(folder).most_of("phase") == MAX_BYTES < Files(folder).most_of("scene")


@pytest.mark.parametrize("name", ["a.toml", "nowhere"])
def test_what_is_no_folder_is_not_listed(files, name):
    assert refusal(lambda: files.listing(name)).startswith(f"{name}: cannot be listed (")


def test_what_can_be_opened(files, folder):
    assert files.opened("smoke/c.npy") == folder.resolve() / "smoke" / "c.npy"
    assert "known: " in refusal(lambda: files.opened("notes.txt"))
    assert "no such file" in refusal(lambda: files.opened("d.vdb"))
    (folder / "e.vdb").mkdir()
    assert "no such file" in refusal(lambda: files.opened("e.vdb"))


def test_only_what_the_page_saved_is_replaced(files, folder):
    first = files.saved("shot", ".exr")
    first.write_bytes(b"picture")
    files.written(first)

    assert first == folder.resolve() / "shot.exr"
    assert files.saved("shot.exr", ".exr") == first
    assert files.saved("smoke/shot.EXR", ".exr").name == "shot.EXR"
    assert files.saved("a", ".exr").name == "a.exr"
    assert refusal(lambda: files.saved("a", ".toml")) == "a.toml: is there already; choose another name"
    assert "folder is not there" in refusal(lambda: files.saved("nowhere/a", ".exr"))
    assert "shorten" in refusal(lambda: files.saved("x" * MOST_NAME, ".exr"))
    assert Files(folder).may_save
    first.write_bytes(b"changed by hand")
    assert "there already" in refusal(lambda: files.saved("shot", ".exr"))


def test_a_scene_reads_nothing_else(files, folder):
    outside = folder.parent / "secret.vdb"
    files.check([folder / "a.toml", folder / "not there.vdb"])
    line = refusal(lambda: files.check([folder / "B.vdb", outside]))
    assert line == "secret.vdb: lies outside the viewer's folder; copy it there first"

    files.trust([outside])
    files.check([outside, folder / ".." / "secret.vdb"])
    other = folder.parent / "folder-2" / "secret.vdb"
    refusal(lambda: files.check([other]))
    files.trust([], lambda path: path == other)
    files.check([other])


@pytest.mark.parametrize("is_relative", [True, False])
def test_data_of_other_frames_are_read_where_those_of_the_first_are(files, folder, is_relative):
    beside = folder.parent / "folder-2"
    for number in (1, 2):
        header = "NRRD0004\ntype: float\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nendian: little\n"
        (beside / f"a.000{number}.nhdr").write_text(f"{header}data file: a.000{number}.raw\n")
    where = ".." if is_relative else folder.parent.as_posix()
    (folder / "a.toml").write_text(f'[volume]\nfile = "{where}/folder-2/a.####.nhdr"\n')
    shot = Shot(folder / "a.toml")
    first, second = (shot.scene_file(number) for number in (1, 2))
    assert [path.name for path in second.files()] == ["a.0002.nhdr", "a.0002.raw"]
    refusal(lambda: files.check(second.files()))
    files.trust(first.files(), first.is_file_of_a_frame)
    files.check(second.files())
    refusal(lambda: files.check([beside / "a.0002.raw"]))  # by itself
    refusal(lambda: files.check([*second.files(), beside / "secret.vdb"]))


@links
def test_what_a_file_in_the_folder_names_is_not_trusted_for_that(files, folder):
    (folder / "a.obj").write_text("mtllib ball.mtl")
    (folder / "ball.mtl").symlink_to(folder.parent / "secret.vdb")
    files.trust([folder / "a.obj"])
    assert "outside" in refusal(lambda: files.check([folder / "a.obj", folder / "ball.mtl"]))


def test_an_upload_is_there_when_it_is_whole(files, folder):
    with files.upload("new.vdb") as open_:
        open_.write(b"on")
        open_.write(b"ce")
        assert "new.vdb" not in names(folder)
        # Another of the same name arrives meanwhile.
        assert upload(files, "new.vdb", b"twice") == "new-2.vdb"
    assert (folder / "new.vdb").read_bytes() == b"once"
    assert upload(files, "B.vdb", b"other") == "B-2.vdb"
    assert (folder / "B.vdb").read_bytes() == b"data"


@pytest.mark.parametrize("error", [ConnectionError, KeyboardInterrupt])
def test_an_upload_that_is_broken_off_leaves_nothing(files, folder, error):
    def broken_off():
        with files.upload("new.vdb") as open_:
            open_.write(b"begins")
            raise error

    before = names(folder)
    with pytest.raises((error, InputError)):
        broken_off()
    assert names(folder) == before
    assert upload(files, "new.vdb", b"data") == "new.vdb"


@pytest.mark.parametrize("chunks", [(), (b"",), (b"x" * 1001,), (b"x" * 600, b"x" * 600)])
def test_an_upload_has_some_bytes_and_not_too_many(files, folder, chunks):
    before = names(folder)
    line = refusal(lambda: upload(files, "new.vdb", *chunks))
    assert "is empty" in line or "larger than 1,000 bytes" in line
    assert names(folder) == before


@pytest.mark.parametrize("name", ["smoke/new.vdb", "new.txt", "new", "x" * MOST_NAME + ".vdb"])
def test_an_upload_has_a_plain_name_of_a_known_kind(files, folder, name):
    before = names(folder)
    refusal(lambda: upload(files, name, b"data"))
    assert names(folder) == before


def test_a_folder_is_one(tmp_path):
    assert "is not a folder" in refusal(lambda: Files(tmp_path / "nowhere"))
