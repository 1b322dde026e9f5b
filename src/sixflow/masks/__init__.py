"""Masks: where to measure, in which frame, and which pixels move together.

| module | what |
|---|---|
| `bodies` | the bodies of one frame: connected parts, or numbered |
| `series` | one mask for all frames, or one for each |
| `files`, `pictures`, `imagej` | masks from files |
| `outlines` | polygons and rectangles as pixels |
| `said` | notes on masks that leave out nothing, or nearly everything |
"""

from sixflow.masks.bodies import REACH as REACH
from sixflow.masks.bodies import Bodies as Bodies
from sixflow.masks.files import MaskFile as MaskFile
from sixflow.masks.files import open_mask as open_mask
from sixflow.masks.files import read_mask as read_mask
from sixflow.masks.series import AnyBodies as AnyBodies
from sixflow.masks.series import MaskLike as MaskLike
from sixflow.masks.series import Masks as Masks

__all__ = ["REACH", "AnyBodies", "Bodies", "MaskFile", "MaskLike", "Masks", "open_mask", "read_mask"]
