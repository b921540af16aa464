"""The options of ``tfm``'s commands as Markdown, from click's own parameters."""

import click
from entries import Entry, definition_list

from tfm_cl.cli import tfm


def options_of(name: str) -> str:
    """Return the usage and the options of a command, in the groups of its help."""
    command = tfm.get_command(click.Context(tfm, info_name="tfm"), name)
    if command is None:
        raise ValueError(f"tfm has no command '{name}'")
    context = click.Context(command, info_name=f"tfm {name}")
    usage = " ".join(command.get_usage(context).removeprefix("Usage: ").split())
    groups: dict[str, list[Entry]] = {}
    for parameter in command.get_params(context):
        if isinstance(parameter, click.Option) and (record := parameter.get_help_record(context)):
            entry = _entry(f"tfm-{name}", parameter, record[1])
            groups.setdefault(getattr(parameter, "group", "Run"), []).append(entry)
    lines = ["```text", usage, "```"]
    for group, entries in groups.items():
        lines += ["", f"**{group}**", "", definition_list(entries)]
    return "\n".join(lines)


def _entry(prefix: str, option: click.Option, text: str) -> Entry:
    """Take an option's line of the help apart: meaning and, in brackets, the default."""
    flags = " / ".join([*option.opts, *option.secondary_opts])
    choices = option.type.choices if isinstance(option.type, click.Choice) else ()
    takes = option.metavar or " | ".join(map(str, choices))
    meaning, _, default = text.removesuffix("]").partition("  [")
    anchor = prefix + "-" + option.opts[-1].lstrip("-")
    return Entry(flags, anchor, takes.replace("|", " | "), default.removeprefix("default: "), meaning)
