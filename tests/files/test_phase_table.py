"""Tables of phase functions in files: what they hold, what is refused, and when they are read."""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.files import phase_table
from tfm_cl.scene.scene_file import SceneFile

TABLE = "# cosine, value\n-1 1\n\n0.5\t2  # a remark\n1, 4\n"


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "measured.txt"
    path.write_text(TABLE)
    return path


def test_a_table(table):
    phase = tfm.TabulatedPhase(file=str(table))
    values = phase.evaluate([-1, 0, 0.5, 1])
    assert np.allclose(values / values[0], [1, 5 / 3, 2, 4])
    assert phase.evaluate(0.5) == pytest.approx(2 / (2 * np.pi * (2.25 + 1.5)))


def test_rows_may_descend_and_ends_are_rounded(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_bytes(b"\xef\xbb\xbf0.9999999,4\r\n0.5,2\r\n-1,1\r\n")
    curve = phase_table.read(str(path))
    assert curve.cosines.tolist() == [-1, 0.5, 1]
    assert np.allclose(curve.values / curve.values[0], [1, 2, 4])


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"", "should hold 2 to 65,536 cosines and as many values; got 0 and 0"),
        (b"-1 1\n1 2 3\n", "line 2 should be a cosine and a value, not '1 2 3'"),
        (b"-1 1\n1\n", "line 2 should be a cosine and a value, not '1'"),
        (b"\x00\xff\x1b[31m\n", "line 1 should be a cosine and a value, not '\\x00"),
        (b"-1 1\n0 1\n0 2\n1 1\n", "cosines should be in order; 0 and 0 are not"),
        (b"-1 1\nnan 1\n1 1\n", "cosines should be in order; -1 and nan are not"),
        (b"0 1\n180 2\n", "cosines should reach from -1 to 1, not from 0 to 180"),
        (b"-1 1\n1 inf\n", "values should be finite and ≥ 0; at cosine 1 is inf"),
        (b"-1 1\n1 -1\n", "values should be finite and ≥ 0; at cosine 1 is -1"),
        (b"-1 0\n1 0\n", "values are all 0: nothing would be scattered"),
        (b"-1 1e308\n1 1e308\n", None),
        (b"0 0\n" * 65_537, "has more than 65,536 rows; leave some out"),
        (b"#" * (4 << 20) + b"#", "larger than 4,194,304 bytes: not a table of a phase function"),
    ],
)
def test_hostile_files(tmp_path, content, fault):
    path = tmp_path / "measured.txt"
    path.write_bytes(content)
    phase = tfm.TabulatedPhase(file=str(path))
    if fault is None:
        assert phase.evaluate(0.3) == pytest.approx(1 / (4 * np.pi))
        return
    with pytest.raises(SceneError) as caught:
        phase.read_files()
    assert str(caught.value).startswith(f"medium.phase.file: {path}: {fault}")
    assert str(caught.value).isprintable()


SUN = tfm.SunLight(from_=(0, 0, 1), to=(0, 0, 0))
SCENE = """
[[volume]]
shape = "box"
{of_volume}
[medium]
{of_medium}
[camera]
from = [0, 0, 4]
to = [0, 0, 0]
res = [4, 3]
"""


@pytest.mark.parametrize(
    ("of_volume", "of_medium"),
    [
        ("", 'phase = "table:measured.txt"'),
        ("", 'phase = { type = "table", file = "measured.txt" }'),
        ('medium = { phase = "table:measured.txt" }', ""),
        ("", 'phase = { type = "mix", phases = ["table:measured.txt", "mie"], weights = [1, 1] }'),
    ],
    ids=["name", "table", "a volume's own", "in a mixture"],
)
def test_names_are_relative_to_the_scene_file(table, renderer, of_volume, of_medium):
    path = table.with_name("scene.toml")
    path.write_text(SCENE.format(of_volume=of_volume, of_medium=of_medium))
    scene_file = SceneFile.read(path)
    assert scene_file.files() == [table]
    scene = scene_file.make(tfm.Scene)
    assert np.isfinite(renderer.render(scene).image).all()

    table.unlink()
    scene.read_files()  # is read
    with pytest.raises(SceneError, match=r"medium\.phase(\.file)?: .*measured.txt: no such file"):
        SceneFile.read(path).make(tfm.Scene).read_files()


def test_a_changed_file_is_another_function(table, renderer):
    def picture():
        body = tfm.BoxVolume(medium=tfm.Medium(phase=f"table:{table}"))
        camera = tfm.Camera(from_=(0, 0, 4), to=(0, 0, 0), res=(4, 3))
        return renderer.render(tfm.Scene(body, camera=camera, lights=[SUN])).image

    before = picture()
    table.write_text("-1 1\n0 0\n1 0\n")
    after = picture()
    assert (after[..., :3].max(axis=(0, 1)) > 2 * before[..., :3].max(axis=(0, 1))).all()
