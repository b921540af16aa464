"""``tfm schema``: what a scene file may say, for editors."""

import json
from pathlib import Path

import click

from tfm_cl.cli.options import GroupedCommand, GroupedOption, plugin_option
from tfm_cl.cli.paths import TARGET
from tfm_cl.files.paths import write_text
from tfm_cl.scene.schema import scene_schema


@click.command("schema", cls=GroupedCommand)
@click.option(
    "-o",
    "output",
    metavar="FILE",
    type=TARGET,
    cls=GroupedOption,
    help="where to write it  [standard output]",
)
@plugin_option
def command(output: Path | None) -> None:
    """Write the JSON Schema of scene files: every key with its meaning, default and range.

    \b
    tfm schema -o scene.schema.json

    An editor with Taplo (the extension "Even Better TOML") then completes and checks a scene file that begins
    with the line "#:schema scene.schema.json".
    """  # noqa: D301 - click wants the character \b, not its escape
    text = json.dumps(scene_schema(), indent=2, ensure_ascii=False) + "\n"
    if output is None:
        print(text, end="")
    else:
        write_text(output, text)
