"""What is kept of compiled kernels, and that no state of it fails a run."""

import contextlib
import fcntl
import hashlib
import io
import os
import resource
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from tfm_cl.device import device as devices
from tfm_cl.device import kernel_cache, program, scratch
from tfm_cl.device.device import choose_device
from tfm_cl.device.kernel_cache import KEPT_DAYS, MOST_BYTES, KernelCache, Store, store_folder
from tfm_cl.device.launch import lanes_of
from tfm_cl.device.scratch import Scratch, make_scratch
from tfm_cl.errors import DeviceError, KernelBuildError

NAME = "a" * 64
CANNOT = "compiled kernels cannot be kept there"


PROGRAM = """
import sys
import numpy as np
from tfm_cl.device.device import choose_device
from tfm_cl.errors import TfmError
from tfm_cl.device.kernel_cache import take_notes
from tfm_cl.device.launch import Launcher

try:
    launcher = Launcher(choose_device(DEVICE), ("-I", "."))
    answer = launcher.empty("the answer", 4)
    launcher.run(launcher.kernels.kernel("answer", "answer.cl"), (1,), {"answer": answer})
    print(launcher.download(answer, (1,), np.int32)[0])
except TfmError as error:
    print(error, file=sys.stderr)
for note in take_notes():
    print(note, file=sys.stderr)
"""


@pytest.fixture
def run(tmp_path, device_name):
    """``run(POCL_CACHE_DIR=…)`` runs a kernel in a process of its own; returns what it says on stderr."""
    if "Portable Computing" not in choose_device(device_name).platform.name:
        pytest.skip("the driver has a cache of its own")
    text = "kernel void answer(global int *answer) { *answer = 42; }\n"
    (tmp_path / "answer.cl").write_text(text, encoding="utf-8")
    temporary = tmp_path / "temporary"
    temporary.mkdir()

    def start(*prefix, **environment):
        kept = {name: v for name, v in os.environ.items() if name not in {"POCL_CACHE_DIR", "XDG_CACHE_HOME"}}
        return subprocess.Popen(
            [*prefix, sys.executable, "-c", PROGRAM.replace("DEVICE", repr(device_name))],
            cwd=tmp_path,
            env=kept | {"TMPDIR": str(temporary)} | {name: str(value) for name, value in environment.items()},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def finish(*prefix, answer="42\n", **environment):
        process = start(*prefix, **environment)
        out, err = process.communicate(timeout=120)
        assert (process.returncode, out) == (0, answer), err
        assert not list(temporary.iterdir())  # nothing is left behind
        return err

    finish.start = start
    return finish


@pytest.fixture
def filled(tmp_path, run):
    """The folder of a cache that a run has filled, with two programs."""
    folder = tmp_path / "cache"
    assert run(POCL_CACHE_DIR=folder) == ""
    assert len(files_of(folder)) == 2
    return folder


def files_of(folder):
    return sorted((folder / "tfm_cl" / "kernels").iterdir())


# ------------------------------------------------------------------------------------- whole runs


@pytest.mark.slow
def test_a_second_run_writes_nothing(filled, run):
    def found():
        return {
            path: (path.stat().st_ino, path.read_bytes())
            for path in (filled / "tfm_cl" / "kernels").iterdir()
        }

    before = found()
    assert run(POCL_CACHE_DIR=filled) == ""
    assert found() == before


def damage_by_cutting(path):
    os.truncate(path, path.stat().st_size // 2)


def damage_by_emptying(path):
    path.write_bytes(b"")


def damage_by_zeros(path):
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 512] = bytes(512)
    path.write_bytes(content)


def damage_by_a_folder(path):
    path.unlink()
    path.mkdir()
    (path / "file").touch()


def damage_by_a_pipe(path):
    path.unlink()
    os.mkfifo(path)


def damage_by_a_dangling_link(path):
    path.unlink()
    path.symlink_to("nowhere")


DAMAGES = (
    damage_by_cutting,
    damage_by_emptying,
    damage_by_zeros,
    damage_by_a_folder,
    damage_by_a_pipe,
    damage_by_a_dangling_link,
)


def test_what_is_damaged_is_compiled_again_once(filled, run):
    for path, damage in zip(
        (filled / "tfm_cl" / "kernels").iterdir(), (damage_by_cutting, damage_by_zeros), strict=True
    ):
        damage(path)
    assert run(POCL_CACHE_DIR=filled) == (
        f"{filled}/tfm_cl/kernels: 2 damaged files thrown away, the kernels in there were compiled again\n"
    )
    assert run(POCL_CACHE_DIR=filled) == ""


@pytest.mark.slow
def test_a_render_warns_of_damage(tmp_path, small_scene, renderer, monkeypatch):
    store = Store(tmp_path / "store")
    (tmp_path / "store" / f"{NAME}{kernel_cache.SUFFIX}").touch()
    assert store.read(NAME) is None
    monkeypatch.setattr(kernel_cache.kernel_cache(), "_store", store)
    assert "1 damaged file thrown away" in renderer.render(small_scene).warnings[-1]
    assert not any("damaged" in warning for warning in renderer.render(small_scene).warnings)


def test_a_run_that_is_killed_while_it_compiles_spoils_nothing(tmp_path, run):
    folder = tmp_path / "cache"
    process = run.start(POCL_CACHE_DIR=folder)
    deadline = time.monotonic() + 60
    while not list((folder / "tfm_cl" / "kernels").glob("*")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    process.communicate()
    (left,) = (tmp_path / "temporary").iterdir()
    long_ago = time.time() - 3600
    os.utime(left, (long_ago, long_ago))
    assert run(POCL_CACHE_DIR=folder) == ""  # which has removed what was left, too


@pytest.mark.quick("file")
@pytest.mark.parametrize("where", ["file", "file/below", "dangling", "locked"])
def test_a_cache_that_cannot_be_made(tmp_path, run, where):
    (tmp_path / "file").touch()
    (tmp_path / "dangling").symlink_to("no/where")
    (tmp_path / "locked").mkdir(mode=0o500)
    if where == "locked" and os.access(tmp_path / "locked", os.W_OK):
        pytest.skip("this user may write everywhere")
    err = run(POCL_CACHE_DIR=tmp_path / where)
    assert err.startswith(f"{tmp_path / where}/tfm_cl/kernels: {CANNOT} (")
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_cache_that_others_may_write_is_not_used(filled, run):
    (filled / "tfm_cl" / "kernels").chmod(0o777)
    assert f"{CANNOT} (others may write there)" in run(POCL_CACHE_DIR=filled)


@pytest.mark.slow
def test_a_home_that_is_not_there(tmp_path, run):
    (tmp_path / "file").touch()
    assert f"{CANNOT} (Not a directory)" in run(HOME=tmp_path / "file" / "home")


def test_no_room_to_compile_is_one_line(tmp_path, run):
    limit = "bash", "-c", 'ulimit -f 64; exec "$@"', "bash"
    err = run(*limit, answer="", POCL_CACHE_DIR=tmp_path / "cache")
    assert err.startswith("no folder has the 32 MiB of room that compiling kernels may take: ")
    assert f"{tmp_path}/temporary (File too large)" in err
    assert f"{tmp_path}/cache/tfm_cl/kernels (File too large)" in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_damaged_database_of_pyopencl_is_not_even_read(tmp_path, run):
    caches = tmp_path / "caches"
    (caches / "pytools").mkdir(parents=True)
    version = ".".join(map(str, sys.version_info))
    (caches / "pytools" / f"pdict-v5-pyopencl-invoker-cache-v42-nano-{version}.sqlite").write_bytes(
        b"no" * 999
    )
    assert run(XDG_CACHE_HOME=caches) == ""


# ------------------------------------------------------------------------------------- its parts


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store")


def test_what_is_kept_is_read_again(tmp_path, store):
    assert store.read(NAME) is None
    store.write(NAME, b"machine code")
    assert store.read(NAME) == b"machine code"
    assert Store(tmp_path / "store").read(NAME) == b"machine code"
    assert store.take_notes() == ()


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_thrown_away_with_a_note(tmp_path, store, damage):
    store.write(NAME, b"machine code" * 999)
    (path,) = (tmp_path / "store").iterdir()
    damage(path)
    assert store.read(NAME) is None
    assert not os.path.lexists(path)
    (note,) = store.take_notes()
    assert note == f"{tmp_path}/store: 1 damaged file thrown away, the kernels in there were compiled again"
    assert store.take_notes() == ()
    store.write(NAME, b"again")
    assert store.read(NAME) == b"again"


def test_every_byte_counts(tmp_path, store):
    store.write(NAME, bytes(range(9)))
    (path,) = (tmp_path / "store").iterdir()
    whole = path.read_bytes()
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert store.read(NAME) is None


def test_an_endless_file_is_not_read(tmp_path, store):
    path = tmp_path / "store" / f"{NAME}{kernel_cache.SUFFIX}"
    packed = bytes(16)
    path.write_bytes(hashlib.sha256(packed).digest() + packed)
    assert store.read(NAME) == packed
    os.truncate(path, MOST_BYTES + 1)
    assert store.read(NAME) is None


def test_what_cannot_be_written_is_noted_once_and_still_read(tmp_path, store, monkeypatch):
    store.write(NAME, b"machine code")

    def full(*_args, **_options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(kernel_cache.tempfile, "NamedTemporaryFile", full)
    store.write("b" * 64, b"more")
    store.write("c" * 64, b"and more")
    (note,) = store.take_notes()
    assert note.startswith(f"{tmp_path}/store: {CANNOT} (No space left on device), so each run compiles them")
    assert store.read(NAME) == b"machine code"


def test_a_half_written_file_is_removed(tmp_path, store, monkeypatch):
    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(kernel_cache.Path, "replace", fail)
    store.write(NAME, b"machine code")
    assert not list((tmp_path / "store").iterdir())
    assert "Input/output error" in store.take_notes()[0]


def test_what_is_long_unused_is_removed(tmp_path, store):
    for name in "abc":
        store.write(name * 64, b"machine code")
    old = time.time() - (KEPT_DAYS + 1) * 86400
    (tmp_path / "store" / "zebra.c").touch()  # somebody's own file
    for name in (*(f"{name * 64}{kernel_cache.SUFFIX}" for name in "ab"), "zebra.c"):
        os.utime(tmp_path / "store" / name, (old, old))
    later = Store(tmp_path / "store")
    assert later.read("a" * 64) is not None  # used now
    later.write("d" * 64, b"machine code")
    assert {path.name[0] for path in (tmp_path / "store").iterdir()} == set("acdz")


def test_a_folder_of_somebody_else_is_not_used(tmp_path, store, monkeypatch):
    store.write(NAME, b"machine code")
    monkeypatch.setattr(os, "geteuid", lambda: 4321)
    other = Store(tmp_path / "store")
    assert other.read(NAME) is None
    other.write(NAME, b"mine")
    monkeypatch.undo()
    assert store.read(NAME) == b"machine code"
    assert f"{CANNOT} (it belongs to somebody else)" in other.take_notes()[0]


def test_without_any_home(monkeypatch):
    for name in ("HOME", "POCL_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as for a user without an entry
    store = Store(store_folder())
    assert store.read(NAME) is None
    assert "there is no home folder" in store.take_notes()[0]
    assert not Path("~").exists()


@pytest.mark.parametrize(
    ("variables", "folder"),
    [
        ({"POCL_CACHE_DIR": "/a/b"}, "/a/b/tfm_cl/kernels"),
        ({"POCL_CACHE_DIR": "", "XDG_CACHE_HOME": "/c"}, "/c/tfm_cl/kernels"),
        ({"HOME": "/d"}, "/d/.cache/tfm_cl/kernels"),
    ],
)
def test_where_it_is(monkeypatch, variables, folder):
    for name in ("HOME", "POCL_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert store_folder() == Path(folder)


@pytest.fixture
def cache(tmp_path, store):
    folder = tmp_path / "scratch"
    folder.mkdir()
    made = Scratch(folder)
    yield KernelCache(made, store)
    made.close()


def compile_into(cache, program, size="4-4-1", compiling=lambda: None):
    """Do what PoCL does: a folder for the program, and in there one for each kernel and work-group size."""
    with program.building(compiling):
        folder = cache.folder / "AB" / program._name[:8]
        found = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "program.bc").write_bytes(b"bitcode")
    code = folder / "kernel" / size / "kernel.so"
    code.parent.mkdir(parents=True, exist_ok=True)
    code.write_bytes(b"code")
    program.keep()
    return found


def test_a_program_comes_back_in_the_next_process(tmp_path, store, cache):
    assert compile_into(cache, cache.program("text", "options")) == []
    assert compile_into(cache, cache.program("other text", "options")) == []
    found, told = [], []
    for size in ("64-1-1", "4-4-4"):
        (tmp_path / size).mkdir()
        following = KernelCache(Scratch(tmp_path / size), store)
        found.append(
            compile_into(following, following.program("text", "options"), size, lambda: told.append(1))
        )
    assert not told  # it was kept
    compile_into(following, following.program("new text"), compiling=lambda: told.append(1))
    assert told == [1]
    first = ["kernel/4-4-1/kernel.so", "program.bc"]
    assert found == [first, sorted([*first, "kernel/64-1-1/kernel.so"])]


def test_a_program_is_written_only_when_there_is_more_of_it(store, cache, monkeypatch):
    program = cache.program("text")
    compile_into(cache, program)
    written = []
    monkeypatch.setattr(store, "write", lambda *_: written.append(1))
    program.keep()
    assert not written
    compile_into(cache, program, size="64-1-1")
    assert written == [1]


def test_only_the_newest_of_a_program_is_kept(tmp_path, store, cache):
    """The same text may include another file, or be for another processor: PoCL has another folder then."""
    compile_into(cache, cache.program("text"))
    (tmp_path / "next").mkdir()
    following = KernelCache(Scratch(tmp_path / "next"), store)
    program = following.program("text")
    with program.building():
        (following.folder / "CD" / "other").mkdir(parents=True)
        (following.folder / "CD" / "other" / "program.bc").touch()
    program.keep()
    (path,) = (tmp_path / "store").iterdir()
    (kept,) = zipfile.ZipFile(io.BytesIO(path.read_bytes()[32:])).namelist()
    assert kept == "CD/other/program.bc"


def test_the_lanes_are_asked_of_the_compiler_once(launcher, cache, store, tmp_path, monkeypatch):
    if "Portable Computing" not in launcher.device.platform.name:
        pytest.skip("the driver has a cache of its own")
    built, build = [], program.build
    monkeypatch.setattr(program, "build", lambda *given: built.append(given) or build(*given))
    monkeypatch.setattr(program, "kernel_cache", lambda: cache)
    assert lanes_of(launcher.context) == launcher.lanes_possible
    (tmp_path / "next").mkdir()
    following = KernelCache(Scratch(tmp_path / "next"), store)
    monkeypatch.setattr(program, "kernel_cache", lambda: following)
    assert lanes_of(launcher.context) == launcher.lanes_possible
    assert len(built) == 1


def test_a_program_that_fails_to_build_is_not_kept(tmp_path, cache):
    program = cache.program("text")
    with contextlib.suppress(ValueError), program.building():
        (cache.folder / "AB" / "half").mkdir(parents=True)
        raise ValueError
    program.keep()
    assert not list(cache.folder.glob("*/*"))
    assert not list((tmp_path / "store").iterdir())


def test_no_room_is_told_before_anything_is_compiled(tmp_path, cache, monkeypatch):
    compile_into(cache, cache.program("text"))
    monkeypatch.setattr(scratch, "ROOM", 1 << 60)
    with pytest.raises(DeviceError, match=f"{tmp_path}/scratch: no room is left for compiling kernels"):
        compile_into(cache, cache.program("other text"))


def test_the_environment_is_as_before():
    before = dict(os.environ)
    with devices._own_caches() as refusal:
        assert refusal is None
        for name in ("POCL_CACHE_DIR", "XDG_CACHE_HOME"):
            assert os.environ[name] != before.get(name)
            assert os.access(os.environ[name], os.W_OK)
    assert dict(os.environ) == before


def test_a_missing_linker_is_named(launcher, monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.setattr(program, "LINKER_FOLDERS", ())
    monkeypatch.setattr(program.importlib.util, "find_spec", lambda _: True)
    program._check_linker("OpenCL 3.0 PoCL 5.0")
    with pytest.raises(KernelBuildError, match=r"needs the linker 'ld'.*apt install binutils"):
        program._check_linker("OpenCL 3.0 PoCL 3.0-rc2")
    monkeypatch.undo()
    program._check_linker(launcher.device.platform.version)


def test_a_lack_of_room_is_not_a_lack_of_devices(monkeypatch):
    def full():
        raise DeviceError("no folder has the room")

    monkeypatch.setattr(devices, "kernel_cache", full)
    monkeypatch.setattr(devices.cl, "get_platforms", list)
    with pytest.raises(DeviceError, match="no folder has the room"):
        choose_device()


def test_a_scratch_folder_goes_with_its_process(tmp_path):
    made = Scratch(tmp_path)
    assert list(tmp_path.iterdir()) == [made.path]
    assert made.path.stat().st_mode & 0o777 == 0o700
    made.close()
    assert not list(tmp_path.iterdir())


def test_a_scratch_folder_goes_while_somebody_writes_there(tmp_path, monkeypatch):
    remove, made = scratch.shutil.rmtree, Scratch(tmp_path)

    def raced(path, **options):
        remove(path, **options)
        if not late:
            late.append((path / "late").mkdir(parents=True))

    late = []
    monkeypatch.setattr(scratch.shutil, "rmtree", raced)
    made.close()
    assert late
    assert not list(tmp_path.iterdir())


def test_only_abandoned_folders_are_removed(tmp_path):
    names = ("scratch-1", "scratch-2", "scratch-3", "0.1.0", "scratch-without-a-lock")
    living, abandoned, fresh, other, unlocked = (tmp_path / f"tfm_cl-{name}" for name in names)
    long_ago = time.time() - 3600
    for folder in (living, abandoned, fresh, other, unlocked):
        folder.mkdir()
        (folder / ("file" if folder == unlocked else "lock")).touch()
    with (living / "lock").open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        for folder in (living, abandoned, other, unlocked):
            os.utime(folder, (long_ago, long_ago))
        made = Scratch(tmp_path)
        assert set(tmp_path.iterdir()) == {living, fresh, other, unlocked, made.path}
        made.close()


def test_a_folder_without_room_is_passed_over(tmp_path, monkeypatch):
    small, large = tmp_path / "small", tmp_path / "large"
    for folder in (small, large):
        folder.mkdir()
    check = Scratch.check_room

    def only_in_large(self):
        if self.path.parent == small:
            raise OSError(28, "No space left on device")
        check(self)

    monkeypatch.setattr(Scratch, "check_room", only_in_large)
    monkeypatch.setattr(scratch, "_temporary_folders", lambda: [tmp_path / "missing", small])
    made = make_scratch([large])
    assert made.path.parent == large
    assert not list(small.iterdir())
    made.close()
    with pytest.raises(
        DeviceError, match=r"32 MiB .*missing \(No such file or directory\), .*small \(No space"
    ):
        make_scratch()


def test_room_is_what_this_process_may_write(tmp_path):
    made = Scratch(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, hard))
    try:
        with pytest.raises(OSError, match="File too large"):
            made.check_room()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    made.check_room()
    made.close()
