"""The options of ``tfm``'s commands as Markdown, from click's own parameters."""

import inspect

import click
from entries import Entry, definition_list

from tfm_cl.cli import tfm


def commands_of(name: str) -> str:
    """Return a section for each of ``all`` commands: what it does, its usage and options, as in its help."""
    if name != "all":
        raise ValueError(f"'{name}': should be all")
    context = click.Context(tfm, info_name="tfm")
    found = [(one, tfm.get_command(context, one)) for one in tfm.list_commands(context)]
    return "\n\n".join(_section(one, command) for one, command in found if command is not None)


def _section(name: str, command: click.Command) -> str:
    context = click.Context(command, info_name=f"tfm {name}")
    usage = " ".join(command.get_usage(context).removeprefix("Usage: ").split())
    # After \b the help shows lines as they are: commands.
    said, *examples = inspect.cleandoc(command.help or "").split("\b\n")
    lines = [f"## tfm {name}", said.strip(), "", "```text", usage, "```"]
    for example in examples:
        lines += ["", "```text", example.strip(), "```"]
    groups: dict[str, list[Entry]] = {}
    for parameter in command.get_params(context):
        if isinstance(parameter, click.Option) and (record := parameter.get_help_record(context)):
            entry = _entry(f"tfm-{name}", parameter, record[1])
            groups.setdefault(getattr(parameter, "group", "Run"), []).append(entry)
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
