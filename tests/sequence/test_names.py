"""What files of a range are called."""

from pathlib import Path

import pytest

from tfm_cl.sequence.names import Files


@pytest.mark.parametrize(
    ("pattern", "ledger", "plan", "name"),
    [
        ("out/shot.####.exr", "out/.shot.tfm", "out/shot.plan.toml", "shot.0007.exr"),
        ("shot_%02d.png", ".shot.tfm", "shot.plan.toml", "shot_07.png"),
        ("####.png", ".frames.tfm", "frames.plan.toml", "0007.png"),
        ("a/####/beauty.exr", "a/.beauty.tfm", "a/beauty.plan.toml", "0007_beauty.exr"),
        ("still.png", ".still.tfm", "still.plan.toml", "still.png"),
    ],
)
def test_beside_the_frames(pattern, ledger, plan, name):
    files = Files((Path(pattern),))
    assert (files.ledger, files.plan, files.name(7)) == (Path(ledger), Path(plan), name)
    assert files.of(7)[0].name == Path(name.replace("_", "/", 1) if "/####/" in pattern else name).name
