"""Fixtures that every test may use: the device, the real volumes, small scenes."""

import contextlib
import os
from collections import defaultdict
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scenes import make_scene

import tfm_cl as tfm
from tfm_cl.device import launch
from tfm_cl.device.device import choose_device
from tfm_cl.device.kernel_cache import POCL
from tfm_cl.device.launch import Launcher
from tfm_cl.files import image_io
from tfm_cl.files.image_io.image import Image

REPOSITORY = Path(__file__).resolve().parents[1]
STRICT = "-Werror"
os.environ["POCL_EXTRA_BUILD_FLAGS"] = STRICT
"""PoCL adds it everywhere: command lines and other processes find what tests of the library have compiled."""
LANES = {"1 lane": 1, "the device's lanes": None}


def pytest_addoption(parser):
    parser.addoption("--cl-device", default=None, help="part of the OpenCL device's name; default PoCL")
    parser.addoption("--every-case", action="store_true", help="leave no slow case out")


DEVICE, ONE = ("the device's lanes",), ("1 lane",)
SLOW_LANES = {
    "kernels": (),
    "bases": DEVICE,
    "test_antialiasing": DEVICE,
    "test_bodies": DEVICE,
    "test_curves": DEVICE,
    "test_emission": DEVICE,
    "test_emission_lights": DEVICE,
    "test_flames": DEVICE,
    "lights": DEVICE,
    "test_maps": DEVICE,
    "test_homogeneous": DEVICE,
    "test_lattice": DEVICE,
    "test_light_at": DEVICE,
    "test_light_layers": DEVICE,
    "test_lit_stretches": DEVICE,
    "test_maps_of_bases": DEVICE,
    "test_octaves": DEVICE,
    "test_points": DEVICE,
    "test_polygons": DEVICE,
    "test_several_volumes": DEVICE,
    "test_solids": DEVICE,
    "test_view_pass": DEVICE,
}
"""Module or folder -> how many rays a work-item are left to the slow step; else one, which no CPU chooses by
itself. Compiling takes most of the time, and less than half as much with one: where a module has many kernels
that is quick, and modules beside it have the device's own number. Most device functions are quick with
both."""


EVERY = 24
"""Of a module's slow cases that differ from others in the rays a work-item only, and that no CPU chooses, so
many are one that is run, from the first on: compiling took a fifth of CI. For GPUs all are compiled."""
OF_PICTURES, OF_CHECKS = {"render", "maps", "plan"}, "test_the_check_sees"
"""Of slow cases of one test of these folders, or of one that tries a check on what is wrong, the first and
the last are run: each compiles kernels of its own. ``--every-case``, or a test's own name, runs all."""


def pytest_collection_modifyitems(config, items):
    """Mark as slow what differs in the rays a work-item only, and all but the `quick` cases of a test."""
    one_lane, others = defaultdict(list), defaultdict(list)
    for item in items:
        slow = SLOW_LANES.get(item.path.stem, SLOW_LANES.get(item.path.parent.name, ONE))
        quick = item.get_closest_marker("quick")
        is_slow = any(lanes in item.name for lanes in slow)
        if is_slow or (quick and case_of(item) not in quick.args):
            item.add_marker(pytest.mark.slow)
        if item.get_closest_marker("slow"):
            if slow and ONE[0] in item.name:
                one_lane[item.path].append(item)
            else:
                others[item.path, item.originalname].append(item)
    if config.getoption("--every-case") or any("::" in argument for argument in config.args):
        return
    left_out = {case for cases in one_lane.values() for case in set(cases) - set(cases[::EVERY])}
    for (path, test), cases in others.items():
        folders = path.relative_to(config.rootpath).parts
        if not OF_PICTURES.isdisjoint(folders) or test.startswith(OF_CHECKS):
            left_out |= set(cases[1:-1])
    if left_out:
        config.hook.pytest_deselected(items=[item for item in items if item in left_out])
        items[:] = [item for item in items if item not in left_out]


def case_of(item):
    """Id of a parametrised test, without the rays a work-item."""
    case = item.callspec.id
    for lanes in LANES:
        case = case.removeprefix(f"{lanes}-")
    return case


def pytest_report_header(config):
    device = choose_device(config.getoption("--cl-device"))
    return f"OpenCL device: {device.platform.name.strip()}: {device.name.strip()}"


@pytest.fixture(scope="session")
def device_name(request):
    return request.config.getoption("--cl-device")


def pytest_generate_tests(metafunc):
    """Run what has the mark `lanes` with one ray a work-item and with as many as the device likes."""
    if metafunc.definition.get_closest_marker("lanes"):
        for name in {"renderer", "launcher"} & set(metafunc.fixturenames):
            metafunc.parametrize(name, LANES.values(), ids=LANES, indirect=True, scope="session")


@pytest.fixture(scope="session")
def strict(device_name):
    """Options that make kernels' warnings errors, where the driver is not told otherwise."""
    return () if POCL in choose_device(device_name).platform.name else (STRICT,)


@pytest.fixture(scope="session")
def renderer(device_name, strict, request):
    """One renderer for all tests; kernel warnings are errors."""
    lanes = getattr(request, "param", None)
    with tfm.Renderer(device_name, build_options=strict, lanes=lanes) as renderer:
        yield renderer


@pytest.fixture(scope="session")
def new_renderer(device_name, strict):
    """Make one more renderer, which is to be closed: what it shares with the others is compiled once."""
    return partial(tfm.Renderer, device_name, build_options=strict)


@pytest.fixture(scope="session")
def one_lane_renderer(new_renderer):
    """One for tests of what does not depend on the rays a work-item: its kernels compile fastest."""
    with new_renderer(lanes=1) as renderer:
        yield renderer


@pytest.fixture(scope="session")
def launcher(device_name, strict, request):
    """Kernels of ``tests/kernels`` as well as the project's own."""
    folder, lanes = Path(__file__).parent / "kernels", getattr(request, "param", None)
    return Launcher(choose_device(device_name), (*strict, "-I", str(folder)), lanes=lanes)


@pytest.fixture
def one_lane(monkeypatch):
    """What this process renders has one ray a work-item: where nothing else matters, this compiles faster."""
    monkeypatch.setattr(launch, "lanes_of", lambda _: (1,))


@pytest.fixture(scope="session")
def shared_volumes():
    """Folder of the real volumes that are not part of the project; skips without."""
    folder = Path(os.environ.get("TFM_VOLUMES", REPOSITORY.parent / "shared" / "volumes"))
    if not folder.is_dir():
        pytest.skip(f"no real volumes in {folder}; set TFM_VOLUMES")
    return folder


@pytest.fixture
def rng():
    return np.random.default_rng(20110218)


@pytest.fixture
def small_scene():
    return make_scene()


@pytest.fixture
def save_on_failure(tmp_path):
    """Write image, reference and difference when a comparison inside the block fails, and name them."""

    @contextlib.contextmanager
    def block(image, reference):
        try:
            yield
        except AssertionError as error:
            difference = np.abs(image - reference)
            paths = []
            for name, pixels in (("image", image), ("reference", reference), ("difference", difference)):
                opaque = np.dstack([pixels[..., :3], np.ones(pixels.shape[:2])]).astype(np.float32)
                for suffix in (".exr", ".png"):
                    paths.append(tmp_path / f"{name}{suffix}")
                    image_io.save(paths[-1], Image(rgba=opaque), pixel_type="float")
            shown = "\n".join(map(str, paths))
            raise AssertionError(
                f"{error}\nlargest difference {difference.max():g}; written:\n{shown}"
            ) from error

    return block
