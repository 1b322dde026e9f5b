"""Prepare: raw frames become frames that can be compared, in one order.

| step | of a frame by itself | of the two frames of a pair |
|---|---|---|
| no data | NaN and ±Inf are masked | what the masks leave out, blank rims, copies |
| defects | | dead and hot pixels get new values |
| low-pass | a Gaussian over both frames | |
| light | the local mean and contrast are divided out (`light`) | whether the light changed (`lighting`) |

Each step sees what the one before has left, and only pixels that count. What a step makes of a frame by itself is kept
for the frame's next pair, as long as nothing before it depends on the pair. The local light is divided out for each
body, by `light.body_lit`: its surroundings end where the body does.
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sixflow.engine.lowpass import lowpass_noise, lowpass_reach, smoothed
from sixflow.engine.threads import beside
from sixflow.errors import BadFrameError
from sixflow.frames.compression import compression_note
from sixflow.frames.floor import Floor, rounding_noise
from sixflow.frames.metadata import Compression
from sixflow.maps.grid import Grid
from sixflow.masks import Bodies
from sixflow.prepare.copies import copied_pixels
from sixflow.prepare.defects import without_defects
from sixflow.prepare.frame import NO_MASK, Frame, both_valid
from sixflow.prepare.image import Grey, to_image, within_range
from sixflow.prepare.interlacing import InterlacingCheck
from sixflow.prepare.lighting import Change
from sixflow.prepare.nodata import continued, within_region, without_blanks
from sixflow.prepare.pattern import FixedPattern
from sixflow.prepare.tiles import SIDE, Tiles


@dataclasses.dataclass
class Prepared:
    """A frame that has been checked, with what is remembered of the raw one.

    Attributes
    ----------
    frame : Frame
        Of a frame by itself: valid where it has a value. Of a pair: valid where it counts, its defects replaced, and
        low-passed, but with its light.
    digesting : Future of bytes
        SHA-256 of the raw frame.
    notes : tuple of str
    bodies : Bodies or None
        What mask and region of interest leave of the frame.
    copied : bool array, shape (height, width), or None
        Of a pair: pixels that a codec took over from one frame to the other (`copies`).
    """

    frame: Frame
    digesting: Future[bytes]
    notes: tuple[str, ...]
    bodies: Bodies | None = None
    copied: NDArray[np.bool_] | None = None

    def evidence(self, frame: Frame, part: tuple[slice, slice]) -> Frame:
        """A part of this frame without the pixels that were copied."""
        if self.copied is None:
            return frame
        return frame.within(both_valid((~self.copied[part]).astype(np.uint8), frame.valid))

    @property
    def digest(self) -> bytes:
        """SHA-256 of the raw frame."""
        return self.digesting.result()

    @property
    def mask_content(self) -> bytes:
        """The mask, for digests; empty without one."""
        return b"" if self.bodies is None else self.bodies.content


def prepare_frame(
    array: NDArray[Any],
    name: str,
    bodies: Bodies | None,
    grey: Grey,
    *,
    floor: Floor,
    interlacing: InterlacingCheck,
    lasting: bool,
    pattern: FixedPattern | None = None,
) -> Prepared:
    """Prepare a frame by itself.

    Parameters
    ----------
    array : array, shape (height, width)
        As `image.check_frame` returns it.
    name : str
        For messages.
    bodies : Bodies or None
        What mask and region of interest leave of it. What they leave out is not looked at, but kept: as the second
        frame of a pair it may count.
    grey : Grey
    floor : Floor
    interlacing : InterlacingCheck
    lasting : bool
        The raw frame stays as it is until the pair is measured.
    pattern : FixedPattern, optional
        Taken out of the image.

    Raises
    ------
    BadFrameError
        If it has no value that can be computed with.
    """
    digest = beside(lambda: hashlib.sha256(np.ascontiguousarray(array).data).digest())
    inside = region_of(bodies)
    image, valid = to_image(array, grey)
    if pattern is not None:
        image -= (pattern.grey * grey.scale).astype(image.dtype)
    if valid.size and not valid.any():
        raise BadFrameError(f"{name} has no pixel of a size that can be computed with; scale its grey values")
    notes = _note_of_missing(name, valid, inside)
    valid = within_range(image, valid, inside, grey.scale, name)
    if valid.size:
        image = continued(image, valid)
    counted = both_valid(inside, valid)
    notes = interlacing.notes(image, name, counted) + notes
    known = floor.with_blocks(array)
    if known is not floor and known.compression:
        notes += (f"{name}: {compression_note(Compression('JPEG', known.compression))}",)
    least, rounded = known.under(_counted(array, inside))
    frame = Frame(image, valid, floor=least * grey.scale, rounded=rounded)
    if not lasting:
        digest.result()
    return Prepared(frame, digest, notes, bodies)


def region_of(bodies: Bodies | None) -> NDArray[np.uint8]:
    """Where any body is, or `NO_MASK` where that is everywhere."""
    if bodies is None or bodies.labels.all():
        return NO_MASK
    return (bodies.labels != 0).astype(np.uint8)


def _counted(array: NDArray[Any], inside: NDArray[np.uint8]) -> NDArray[Any]:
    """The pixels that a mask leaves, as an array of one column; the array itself without a mask."""
    return array[inside.astype(np.bool_)][:, None] if inside.size else array


def _note_of_missing(name: str, valid: NDArray[np.uint8], inside: NDArray[np.uint8]) -> tuple[str, ...]:
    """How many pixels have no value, of those that the mask leaves."""
    missing = 0
    if valid.size:
        missing = int(np.count_nonzero((valid == 0) & (inside != 0) if inside.size else valid == 0))
    return (f"{name}: {missing} pixels without a value (NaN or infinite) are masked",) if missing else ()


@dataclasses.dataclass(frozen=True)
class PreparedPair:
    """Two frames that can be compared, but for their local light, and what was done to them.

    Attributes
    ----------
    reference, moved : Prepared
    change : Change
        Of the light between them, seen without their motion.
    blank : (int, int)
        Number of blank pixels in each.
    copied : float
        Share of copies among the pixels that count.
    dead : int
        Number of dead or hot pixels that were replaced.
    """

    reference: Prepared
    moved: Prepared
    change: Change
    blank: tuple[int, int]
    copied: float
    dead: int

    def notes(self, numbers: tuple[int, int]) -> tuple[str, ...]:
        """What was done to pixels of frames with these numbers."""
        notes = [
            f"frame {number}: {count} pixels of one value at the rim, where the other frame has content or the same "
            "rim, are taken for beyond its end"
            for number, count in zip(numbers, self.blank, strict=True)
            if count
        ]
        pair = f"frames {numbers[0]} and {numbers[1]}"
        if self.copied:
            notes.append(
                f"{pair}: {self.copied:.0%} of the pixels are copies that the video codec made of the frame before; "
                "they are no evidence of motion, and are left out"
            )
        if self.dead:
            notes.append(f"{pair}: {self.dead} dead or hot pixels were replaced")
        return tuple(notes)


def prepare_pair(
    reference: Prepared,
    moved: Prepared,
    *,
    masks_move: bool,
    robust: bool,
    copies: bool,
    lowpass: float,
) -> PreparedPair:
    """Prepare the two frames of a pair: no data, defects, low-pass; and tell whether the light changed.

    Parameters
    ----------
    reference, moved : Prepared
        Each by itself.
    masks_move : bool
        Whether there is a mask for each frame; else that of the reference holds in the reference alone.
    robust : bool
        Whether blank rims and defects are looked for.
    copies : bool
        Whether a codec may have copied pixels.
    lowpass : float
        Of the Gaussian, px; 0 for none.
    """
    region = region_of(reference.bodies)
    there = moved.bodies if masks_move else None
    first = within_region(reference.frame, region)
    second = within_region(moved.frame, region_of(there and (there.whole or there)))
    copied = _copied(first, second) if copies else None
    blank, dead = (0, 0), 0
    if robust:
        first, second, blank = without_blanks(first, second)
        unmasked = reference.frame if region.size and there is None else None
        first, second, dead = without_defects(first, second, unmasked)
    # without a mask of its own, frame 1 is compared where that of frame 0 is
    alike = second if there is not None else second.within(both_valid(region, second.valid))
    change = Change.between(Tiles.matched(first, alike, Grid.over(first.image.shape, SIDE // 4)))
    pair = [
        dataclasses.replace(one, frame=lowpassed(frame, lowpass), copied=copied)
        for one, frame in ((reference, first), (moved, second))
    ]
    share = (
        0.0
        if copied is None
        else float(copied.mean() if not first.valid.size else copied[first.valid > 0].mean())
    )
    return PreparedPair(pair[0], pair[1], change, blank, share, dead)


def _copied(first: Frame, second: Frame) -> NDArray[np.bool_] | None:
    """Pixels that a codec copied from one frame to the other; None if there are none."""
    counted = both_valid(first.valid, second.valid)
    step = math.sqrt(12) * rounding_noise(_counted(first.image, first.valid))
    copied = copied_pixels(first.image, second.image, step, counted)
    return copied if copied.any() else None


def lowpassed(frame: Frame, lowpass: float) -> Frame:
    """Return a frame after a Gaussian of `lowpass` px, its noise with it; the frame itself for 0."""
    if not lowpass:
        return frame

    def make() -> Frame:
        reach = frame.reach + lowpass_reach(lowpass)
        floor = frame.floor * math.sqrt(lowpass_noise(lowpass))
        return Frame(smoothed(frame.image, lowpass), frame.valid, reach, floor, frame.rounded)

    return frame.derived(("low-pass", lowpass), make)
