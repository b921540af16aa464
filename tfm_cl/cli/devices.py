"""``tfm devices``: what OpenCL offers on this machine."""

import json
import sys

import click

from tfm_cl.errors import NoDeviceError


@click.command("devices")
@click.option("--json", "as_json", is_flag=True, help="print JSON")
def command(*, as_json: bool) -> None:
    """List every OpenCL device, its limits, and which one would be used (*)."""
    # Imported here: the help of `tfm` needs no OpenCL.
    from tfm_cl.device.device import HOW_TO_GET_ONE, VARIABLE, list_devices  # noqa: PLC0415

    devices = list_devices()
    if as_json:
        print(json.dumps([device.to_dict() for device in devices], indent=2))
    if not devices:
        for system, package in HOW_TO_GET_ONE.items():
            print(f"{system:15} {package}", file=sys.stderr)
        raise NoDeviceError("no OpenCL device found; install one of these")
    if as_json:
        return
    for device in devices:
        print(f"{'*' if device.default else ' '} {device.number}  {device.name}")
        print(f"    platform:device  {device.place}, {device.platform}, {device.version}")
        print(f"    kind             {device.kind}, {device.compute_units} compute units")
        print(f"    memory           {device.global_memory / 2**20:,.0f} MiB")
        print(f"    largest buffer   {device.max_allocation / 2**20:,.0f} MiB")
        print(f"    work-group       up to {device.max_work_group:,}")
    print(f"* is used unless --device, or {VARIABLE}, says otherwise")
