"""The structs that host and kernels share, as the compiler lays them out."""

import numpy as np
import pytest
from kernel_calls import Calls

from tfm_cl.device.structs import STRUCTS


def test_offsets_agree_with_the_compiler(launcher, tmp_path):
    text = "".join(
        f"""__kernel void offsets_of_{struct.name}(__global const char *bytes, __global int *offsets)
        {{
          {struct.name.upper()} of = ({struct.name.upper()})bytes;
          {
            "".join(
                f"offsets[{i}] = (int)((__global const char *)&of->{field.name} - bytes);"
                for i, field in enumerate(struct.fields)
            )
        }
          offsets[{len(struct.fields)}] = (int)sizeof({struct.name});
        }}
        """
        for struct in STRUCTS
    )
    (tmp_path / "offsets.cl").write_text(text, encoding="utf-8")
    calls = Calls(launcher, tmp_path / "offsets.cl")
    for struct in STRUCTS:
        bytes_ = launcher.upload("the struct", np.zeros((), struct.dtype))
        count = len(struct.fields) + 1
        offsets = launcher.empty("the offsets", 4 * count)
        calls.run(f"offsets_of_{struct.name}", 1, bytes=bytes_, offsets=offsets)

        expected = [struct.dtype.fields[field.name][1] for field in struct.fields] + [struct.dtype.itemsize]

        assert launcher.download(offsets, (count,), np.int32).tolist() == expected, struct.name


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.name)
def test_names_are_not_repeated(struct):
    names = [field.name for field in struct.fields]
    assert len(set(names)) == len(names)
