"""What bodies of files say of how fast their contents move, in scene files."""

from pydantic import Field

from tfm_cl.limits import FRAMES_A_SECOND, LARGEST_COLOUR
from tfm_cl.scene.movable import Movable


class MovingSettings(Movable):
    """What all kinds have in common."""

    velocity_scale: float = Field(
        default=1.0,
        ge=-LARGEST_COLOUR,
        le=LARGEST_COLOUR,
        description="motion blur: factor of the velocities, which are in the file's units per second",
    )
    velocity_fps: float = Field(
        default=FRAMES_A_SECOND, gt=0, le=LARGEST_COLOUR, description="motion blur: frames a second"
    )
