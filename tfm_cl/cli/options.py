"""Command-line options that are keys of a scene file: one table, help and defaults from the models."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import click

from tfm_cl.constants import TARGETS
from tfm_cl.errors import Faults
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.base import FITS, LOOKUPS, RANGES
from tfm_cl.model import Model
from tfm_cl.scene import looks
from tfm_cl.scene.frames import as_direction
from tfm_cl.scene.lights import LIGHTS, SpotLight
from tfm_cl.scene.pixel_filters import FILTERS
from tfm_cl.scene.presets import PRESETS
from tfm_cl.scene.scene_file import SECTIONS
from tfm_cl.scene.settings import ENVIRONMENT


def numbers(text: str) -> Any:
    """``1`` or ``1,2,3``."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"'{text}' is not a number, nor numbers with commas between") from None
    return values[0] if len(values) == 1 else values


def number_or_auto(text: str) -> Any:
    """``1.5`` or ``auto``."""
    return text if text == "auto" else numbers(text)


def colour_or_environment(text: str) -> Any:
    """``1,2,3``, ``1`` or ``environment``."""
    return text if text == ENVIRONMENT else numbers(text)


def direction(text: str) -> Any:
    """``0,0,1`` or ``z``."""
    try:
        return numbers(text)
    except click.BadParameter:
        pass
    try:
        return as_direction(text)
    except ValueError as error:
        raise click.BadParameter(f"'{text}' {error}") from None


def count_or_auto(text: str) -> Any:
    """``100`` or ``auto``."""
    try:
        return text if text == "auto" else int(text)
    except ValueError:
        raise click.BadParameter(f"'{text}' is not a whole number, nor auto") from None


def pixels(text: str) -> list[int]:
    """``x0,y0,x1,y1``."""
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"'{text}' is not whole numbers with commas between") from None


def resolution(text: str) -> list[int]:
    """``1280x720``."""
    width, _, height = text.lower().replace("×", "x").partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise click.BadParameter(f"'{text}' is not WIDTHxHEIGHT, as 1280x720")
    return [int(width), int(height)]


def two_numbers(text: str) -> list[float]:
    """``-0.25,0.25``."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"'{text}' is not two numbers with a comma between") from None


def names(text: str) -> list[str]:
    """``depth,samples``."""
    return [name.strip() for name in text.split(",") if name.strip()]


def toml_value(text: str) -> Any:
    """Read a value as TOML writes it; ``1,2,3`` and bare words serve too."""
    for candidate in (text, f"[{text}]") if text else ():
        try:
            read = tomllib.loads(f"value = {candidate}")
        except (ValueError, RecursionError):  # also of integers of thousands of digits
            continue
        if len(read) == 1:  # no further lines with keys of their own
            return read["value"]
    return text


COLOUR = "R,G,B"
"""Metavar of colours, for which one number serves too."""


@dataclass(frozen=True)
class SceneOption:
    """A flag that sets one key of the scene."""

    group: str
    flag: str
    key: str
    metavar: str
    parse: Callable[[str], Any] | click.ParamType[Any]
    otherwise: str = ""
    """The default where it is not (only) a value of the model."""

    @property
    def parameter(self) -> str:
        """Name of the function parameter that click fills."""
        return "scene_" + self.flag.removeprefix("--").replace("-", "_")

    @property
    def declared(self) -> str:
        """What click calls it: what is on or off has a flag for each."""
        return f"{self.flag}/{_off(self.flag)}" if self.parse is click.BOOL else self.flag

    def help(self) -> str:
        """Return description and default, from the model."""
        section, _, key = self.key.partition(".")
        model: type[Model] = SpotLight if section == "light" else SECTIONS[section]
        name = model.keys()[key]
        field = model.model_fields[name]
        # A subclass that narrows a field's type leaves the description to its base.
        fields = (base.model_fields.get(name) for base in model.__mro__ if issubclass(base, Model))
        description = next(base.description for base in fields if base and base.description)
        known = not field.is_required() and field.default not in {None, ()}
        defaults = [self.shown(field.default)] * known + [self.otherwise] * bool(self.otherwise)
        return f"{description}  [{'; '.join(defaults)}]"

    def shown(self, value: Any) -> str:
        """Write a value as the flag takes it, to the last digit."""
        grey = self.metavar.startswith(COLOUR) and len(set(value)) == 1
        return _shown(value[0] if grey else value)

    def given(self, value: Any) -> str:
        """Write the flag that sets a value."""
        if isinstance(value, bool):
            return self.flag if value else _off(self.flag)
        return f"{self.flag} {self.shown(value)}"


SCENE_OPTIONS = (
    SceneOption("Image", "--res", "camera.res", "WxH", resolution),
    SceneOption("Image", "--crop", "image.crop", "X0,Y0,X1,Y1", pixels, "the whole frame"),
    SceneOption("Image", "--samples", "image.samples", "N", click.INT),
    SceneOption("Image", "--filter", "image.filter", "", click.Choice(list(FILTERS))),
    SceneOption("Image", "--exposure", "image.exposure", "STOPS|auto", number_or_auto),
    SceneOption("Image", "--view", "image.view", "", click.Choice(list(VIEWS))),
    SceneOption("Image", "--background", "image.background", f"{COLOUR}|environment", colour_or_environment),
    SceneOption("Image", "--transparent", "image.transparent", "", click.BOOL),
    SceneOption("Image", "--png-bits", "image.png_bits", "8|16", click.INT),
    SceneOption("Image", "--dither", "image.dither", "", click.BOOL),
    SceneOption("Image", "--deep-tolerance", "image.deep_tolerance", "E", click.FLOAT),
    SceneOption("Image", "--deep-colour", "image.deep_colour", "", click.BOOL),
    SceneOption("Image", "--shutter", "image.shutter", "OPEN,CLOSE", two_numbers, "none"),
    SceneOption("Image", "--motion-samples", "image.motion_samples", "N", click.INT),
    SceneOption("Image", "--aov", "image.aov", "NAME[,NAME]", names, "none"),
    SceneOption("Method", "--method", "march.method", "", click.Choice(["tfm", "dual"])),
    SceneOption("Map", "--basis", "map.basis", "NAME", click.Choice(["auto", *BASES])),
    SceneOption("Map", "--coeffs", "map.coeffs", "N|auto", count_or_auto),
    SceneOption("Map", "--map-bytes", "map.bytes", "B", click.FLOAT, "none"),
    SceneOption("Map", "--max-error", "map.max_error", "E", click.FLOAT, "none"),
    SceneOption("Map", "--density-weighting", "map.density_weighting", "A|auto", number_or_auto),
    SceneOption("Map", "--target", "map.target", "", click.Choice(["auto", *TARGETS])),
    SceneOption("Map", "--fit", "map.fit", "", click.Choice(["auto", *FITS])),
    SceneOption("Map", "--range", "map.range", "", click.Choice(["auto", *RANGES])),
    SceneOption("Map", "--lookup", "map.lookup", "", click.Choice(["auto", *LOOKUPS, "lattice"])),
    SceneOption("Map", "--map-res", "map.res", "N|auto", count_or_auto, "bare: auto"),
    SceneOption("Map", "--light-steps", "map.steps", "N|auto", count_or_auto, "bare: auto"),
    SceneOption("Map", "--storage", "map.storage", "", click.Choice(["f32", "f16", "u8"])),
    SceneOption("March", "--steps", "march.steps", "N|auto", count_or_auto, "bare: auto"),
    SceneOption("March", "--sampling", "march.sampling", "", click.Choice(["projective", "world"])),
    SceneOption("March", "--cutoff", "march.cutoff", "T", click.FLOAT),
    SceneOption("March", "--voxels", "march.voxels", "", click.Choice(["f32", "f16", "u8"])),
    SceneOption("Medium", "--grid", "volume.grid", "NAME", click.STRING, "density, else the only one"),
    SceneOption("Medium", "--density-scale", "volume.density_scale", "X|auto", number_or_auto, "bare: auto"),
    SceneOption("Medium", "--preset", "medium.preset", "", click.Choice(list(PRESETS)), "none"),
    SceneOption("Medium", "--sigma-s", "medium.sigma_s", COLOUR, numbers),
    SceneOption("Medium", "--sigma-a", "medium.sigma_a", COLOUR, numbers),
    SceneOption("Medium", "--octaves", "medium.octaves", "N", click.INT),
    SceneOption("Medium", "--orders", "medium.orders", "N", click.INT),
    SceneOption("Medium", "--phase", "medium.phase", "NAME[:P[:P…]]", click.STRING),
    SceneOption("Camera", "--camera-from", "camera.from", "X,Y,Z", numbers, "the volume fills the frame"),
    SceneOption("Camera", "--camera-to", "camera.to", "X,Y,Z", numbers, "the volume's centre"),
    SceneOption("Camera", "--up", "camera.up", "X,Y,Z|AXIS", direction),
    SceneOption("Camera", "--fov", "camera.fov", "DEG", click.FLOAT),
    SceneOption("Camera", "--focal-length", "camera.focal_length", "MM", click.FLOAT, "none: fov"),
    SceneOption("Light", "--light-type", "light.type", "", click.Choice(list(LIGHTS))),
    SceneOption("Light", "--light-from", "light.from", "X,Y,Z", numbers, "above and to the left"),
    SceneOption("Light", "--light-to", "light.to", "X,Y,Z", numbers, "the volume's centre"),
    SceneOption("Light", "--cone", "light.cone", "DEG", click.FLOAT, "placed: holds the volume"),
    SceneOption("Light", "--intensity", "light.intensity", COLOUR, numbers, "placed: 15"),
    SceneOption("Light", "--falloff", "light.falloff", "", click.Choice(["none", "inverse-square"])),
)
"""Flags of the first light change ``[[light]]`` number 0; others are reached by ``--set light.1.cone=30``."""


class GroupedCommand(click.Command):
    """A command whose help lists its options in groups, and whose errors name the nearest option."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section a group, in the order of the options."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                groups.setdefault(getattr(parameter, "group", "Run"), []).append(record)
        for group, records in groups.items():
            with formatter.section(group):
                formatter.write_dl(records)


class GroupedOption(click.Option):
    """An option that knows its group."""

    def __init__(self, *args: Any, group: str = "Run", **attributes: Any) -> None:
        self.group = group
        super().__init__(*args, **attributes)


plugin_option = click.option(
    "--plugin",
    "plugins",
    metavar="FILE",
    multiple=True,
    cls=GroupedOption,
    expose_value=False,
    help="Python file that registers bases, phase functions, lights, solids or formats; may be repeated  "
    "[$TFM_CL_PLUGINS]",
)
"""Of every command that reads scenes; `tfm_cl.cli.main` runs the files before it."""


def scene_options(*, without: tuple[str, ...] = ()) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add the flags of `SCENE_OPTIONS` to a command, and ``--set``."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        function = plugin_option(function)
        function = click.option(
            "--set",
            "settings",
            metavar="KEY=VALUE",
            multiple=True,
            cls=GroupedOption,
            help="any key of the scene file, as march.max_stretch=8; may be repeated",
        )(function)
        for option in reversed(SCENE_OPTIONS):
            if option.flag in without:
                continue
            typed = option.parse if isinstance(option.parse, click.ParamType) else click.STRING
            function = click.option(
                option.declared,
                option.parameter,
                default=None,
                metavar=option.metavar or None,
                type=typed,
                cls=GroupedOption,
                group=option.group,
                help=option.help(),
            )(function)
        return function

    return decorate


LOOKS = click.Choice([looks.AUTO, looks.PLAIN, *looks.LOOKS])
look_option = click.option(
    "--look",
    type=LOOKS,
    default=looks.AUTO,
    cls=GroupedOption,
    group="Image",
    help="what is chosen where nothing is given: medium, sky, ground, framing, view; plain: one spot on what "
    "scatters once, as in the papers; auto: what fits a bare file, and plain for a scene  [auto]",
)
device_option = click.option(
    "--device",
    metavar="NAME|NUMBER",
    cls=GroupedOption,
    help="part of an OpenCL device's name, its number in `tfm devices`, or platform:device  "
    "[$TFM_CL_DEVICE, else a GPU, else PoCL]",
)
"""Of every command that uses a device."""
scheduler_option = click.option(
    "--scheduler",
    metavar="ADDRESS",
    cls=GroupedOption,
    help="do the work on the workers of a Dask scheduler, as tcp://host:8786, which see the same files "
    "(needs pip install 'tfm_cl[dask]')",
)
"""Of every command whose work is in jobs."""


def overrides(given: dict[str, Any], settings: tuple[str, ...]) -> list[tuple[str, Any]]:
    """Turn the flags given, then ``--set``, into pairs of a dotted scene key and a value.

    Raises
    ------
    SceneError
        One line for each that is not of its form.
    """
    pairs, faults = [], Faults()
    for option in SCENE_OPTIONS:
        value = given.get(option.parameter)
        if value is None:
            continue
        if not isinstance(option.parse, click.ParamType):
            try:
                value = option.parse(value)
            except click.BadParameter as error:
                faults.add(f"{option.flag}: {error.message}")
                continue
        pairs.append((option.key, value))
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or "." not in key:
            faults.add(f"--set {setting}: should be SECTION.KEY=VALUE, as camera.fov=30")
        pairs.append((key.strip(), toml_value(text.strip())))
    faults.raise_any()
    return pairs


def as_flags(values: dict[str, Any]) -> str:
    """Write dotted keys and values as the flags that set them; keys without a flag are ``--set``."""
    options = {option.key: option for option in SCENE_OPTIONS}
    return " ".join(
        options[key].given(value)
        if key in options
        else f"--set {key}={_shown(value)}"
        if "." in key
        else f"--{key} {value}"
        for key, value in values.items()
    )


def _off(flag: str) -> str:
    return "--no-" + flag.removeprefix("--")


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        separator = "x" if len(value) == 2 else ","  # noqa: PLR2004 - width and height
        return separator.join(_shown(item) for item in value)
    if isinstance(value, Model):
        return str(getattr(value, "type", value))
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
