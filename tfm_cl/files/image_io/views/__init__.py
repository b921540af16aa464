"""View transforms: from exposed scene-linear light to the light of a display, one module per transform.

To add one, write a module like `View` and list it in ``VIEWS``. All are closed forms, so that a picture is
the same wherever it is made. Of greys, which stay grey, they are a rising curve from 0.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tfm_cl.files.image_io.views import aces, agx, filmic, standard

Floats = NDArray[np.floating[Any]]


class View(Protocol):
    """A module of this package."""

    NAME: str
    """In scene files."""
    SUMMARY: str
    """For the help."""

    def display(self, rgb: Floats) -> Floats:
        """Transform linear Rec. 709 colours.

        Parameters
        ----------
        rgb
            [3, n], exposed, finite and at least 0.

        Returns
        -------
        NDArray
            [3, n], of the same primaries and still linear, 0 to 1 (the display's white).
        """
        ...


_MODULES: tuple[View, ...] = (standard, filmic, agx, aces)
VIEWS: dict[str, View] = {view.NAME: view for view in _MODULES}
"""The views by their names in scene files."""

__all__ = ["VIEWS", "View"]
