import pyopencl as cl
import pytest

from tfm_cl.device.device import HOW_TO_GET_ONE

KEYS = {
    *("number", "place", "name", "platform", "version", "kind", "compute_units"),
    *("global_memory", "max_allocation", "max_work_group", "default"),
}


def test_json_lists_what_opencl_lists(cli):
    shown = cli("devices", "--json").json
    there = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    assert len(shown) == len(there)
    for row, device in zip(shown, there, strict=True):
        assert set(row) == KEYS
        assert row["name"] == device.name.strip()
        assert row["platform"] == device.platform.name.strip()
        assert row["global_memory"] == device.global_mem_size
        assert row["max_allocation"] == device.max_mem_alloc_size
    assert sum(row["default"] for row in shown) == 1


def test_text_marks_the_one_that_would_be_used(cli):
    (default,) = (row["name"] for row in cli("devices", "--json").json if row["default"])
    done = cli("devices")
    assert done.err == ""
    assert f"* 0  {default}" in done.out.splitlines()


def test_the_device_that_is_marked_renders(cli, cloud, tiny):
    (default,) = (row["name"] for row in cli("devices", "--json").json if row["default"])
    report = cli("render", cloud, "-o", "a.npy", "--json", "-", *tiny[:8]).json
    assert report["device"]["name"] == default


@pytest.mark.parametrize("as_json", [False, True])
def test_without_any_device(cli, monkeypatch, as_json):
    monkeypatch.setattr("tfm_cl.device.device._all_devices", list)
    done = cli("devices", *(["--json"] if as_json else []))
    assert done.code == 3
    assert done.out == ("[]\n" if as_json else "")
    *systems, last = done.err.splitlines()
    assert {line.partition("  ")[0] for line in systems} == set(HOW_TO_GET_ONE)
    assert "pip install 'pyopencl[pocl]'" in systems[0]
    assert last == "tfm: no OpenCL device found; install one of these"


def test_one_line_where_a_device_is_needed(refused, cloud, monkeypatch):
    monkeypatch.setattr("tfm_cl.device.device._all_devices", list)
    assert "`tfm devices` lists what" in refused("render", cloud, "-o", "a.npy", "-q", code=3)
