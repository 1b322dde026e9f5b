"""Bad frames: frames that a recording has, but that cannot be read or used."""

from __future__ import annotations

import dataclasses

from sixflow.errors import SixflowError


@dataclasses.dataclass(frozen=True)
class BadFrame:
    """Stands in a recording for a frame that cannot be read.

    Attributes
    ----------
    name : str
        Of the frame: the file, or the number.
    error : SixflowError
        What a call raises that cannot go on without the frame; its message names the frame and the reason.
    """

    name: str
    error: SixflowError
