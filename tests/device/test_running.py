"""What was started on the device, and what is read of it."""

import pytest

from tfm_cl.device.running import Finding, Running
from tfm_cl.errors import DeviceError


def fail():
    raise DeviceError("gone")


@pytest.mark.parametrize(("end", "read"), [(fail, lambda: 3), (lambda: 0.0, fail)], ids=["made", "read"])
def test_what_could_not_be_made_or_read_has_failed(end, read):
    finding = Finding(Running(end), read, 8)
    with pytest.raises(DeviceError, match="gone"):
        _ = finding.found
    assert finding.running.has_failed


def test_what_failed_is_not_well_again_because_it_can_be_read():
    finding = Finding(Running(fail), lambda: 3, 8)
    finding.running.give_up()
    assert finding.found == 3
    assert finding.running.has_failed


def test_what_was_found_stays():
    finding = Finding(Running(lambda: 1.0), iter([3]).__next__, 8)
    assert finding.found == finding.found == 3
    assert not finding.running.has_failed
