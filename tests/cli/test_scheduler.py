"""``--scheduler``: what is refused before anything is rendered. tests/jobs has the clusters."""

import pytest

from tfm_cl.jobs import cluster


@pytest.fixture
def nobody(monkeypatch):
    """An address where no scheduler answers, which is soon found out."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "CONNECTED_BY", 0.3)
    return "tcp://127.0.0.1:9"


@pytest.mark.parametrize(
    "command", [("render", "-o", "a.####.png", "--frames", "1-3"), ("sweep", "-o", "out")], ids=lambda c: c[0]
)
def test_no_scheduler(cli, cloud, nobody, command):
    name, *options = command
    done = cli(name, cloud, *options, "--scheduler", nobody)
    assert (done.code, done.out) == (3, "")
    assert done.err.startswith(f"tfm: {nobody}: no Dask scheduler answers there (")
    assert len(done.err.splitlines()) == 1
    assert [path.name for path in cloud.parent.iterdir()] == [cloud.name]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("render", "-o", "a.png"), "--scheduler is of several frames: say which with --frames"),
        (
            ("render", "-o", "a.####.png", "--frames", "1-3", "--jobs", "2"),
            "--jobs is of this machine, --scheduler of others; keep one",
        ),
        (("sweep", "-o", "out", "--jobs", "2"), "jobs = 2: the workers of tcp://127.0.0.1:9 do the work"),
    ],
)
def test_what_does_not_go_together(cli, cloud, nobody, options, told):
    name, *rest = options
    done = cli(name, cloud, *rest, "--scheduler", nobody)
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert told in done.err
    assert [path.name for path in cloud.parent.iterdir()] == [cloud.name]


def test_without_dask(cli, cloud, monkeypatch):
    monkeypatch.setattr(cluster, "missing", lambda extra: f"needs distributed: pip install 'tfm_cl[{extra}]'")
    done = cli("render", cloud, "-o", "a.####.png", "--frames", "1-3", "--scheduler", "tcp://127.0.0.1:9")
    assert (done.code, done.err) == (2, "tfm: --scheduler needs distributed: pip install 'tfm_cl[dask]'\n")
