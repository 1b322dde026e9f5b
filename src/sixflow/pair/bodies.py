"""Bodies: every body of a pair measured by itself, in a part of the frames that leaves room for its motion."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sixflow.convention.flags import FLAGS
from sixflow.errors import BadFrameError
from sixflow.maps.grid import Grid
from sixflow.maps.placing import masked_points, placed
from sixflow.pair.body import Body
from sixflow.pair.start import Start
from sixflow.plan import Plan
from sixflow.prepare.frame import NO_MASK, Frame, both_valid
from sixflow.prepare.light import BodyLight, body_lit
from sixflow.prepare.prepare import Prepared
from sixflow.refine.solution import Part, Solution, assembled
from sixflow.search.pyramid import pyramid

FAILED = 0.5
"""Share of a body's points that have to fail near where it was, before it is sought in the whole frame."""
MANY_BODIES = 4
"""From which one search for all, to begin with, is cheaper than one for each."""


def with_margin(box: Part, shape: tuple[int, int], margin: int) -> Part:
    """Rows and columns of a part of the frame and so many around it."""
    rows, columns = (
        slice(max(0, part.start - margin), min(size, part.stop + margin))
        for part, size in zip(box, shape, strict=True)
    )
    return rows, columns


def room_to_move(box: Part, window: float) -> int:
    """Pixels around a body that it is looked for in first: two windows, or half its longer side."""
    return math.ceil(max(2 * window, max(part.stop - part.start for part in box) / 2))


@dataclasses.dataclass(frozen=True)
class PairBodies:
    """The bodies of a prepared pair of frames, and how they are measured.

    Attributes
    ----------
    reference, moved : Prepared
        The two frames, prepared together.
    plan : Plan
        With the lighting that was found for this pair.
    masks_move : bool
        Whether there is a mask for each frame.
    guess : array, shape (6, rows, columns), or None
        A user's first guess, at points of frame 0.
    changed : bool, optional
        As in `Body`.
    """

    reference: Prepared
    moved: Prepared
    plan: Plan
    masks_move: bool = False
    guess: NDArray[np.float64] | None = None
    changed: bool | None = None

    def measure(self, start: Start | None) -> Solution:
        """Measure every body; where there is one only, all that the mask leaves.

        Parameters
        ----------
        start : Start, optional
            What is known of the motion.
        """
        bodies = self.reference.bodies
        if bodies is None or len(bodies.boxes) < 2:
            return self._in_part(None, self._everywhere, self._everywhere, start)
        if start is None and len(bodies.boxes) >= MANY_BODIES:
            start = self._in_common()
        return assembled(self.plan.grid.shape, [*self._each(start)])

    @property
    def _everywhere(self) -> Part:
        """All rows and columns of the frames."""
        height, width = self.plan.shape
        return slice(0, height), slice(0, width)

    @property
    def _at_frame_0(self) -> bool:
        """Whether grid points lie where the bodies are in frame 0."""
        return self.plan.reference == "first"

    def _each(self, start: Start | None) -> Iterator[tuple[int, Part, Solution]]:
        """Number, places in the grid and solution of every body that has grid points."""
        bodies, shape, grid = self.reference.bodies, self.plan.shape, self.plan.grid
        assert bodies is not None
        for number, box in bodies.boxes.items():
            near = with_margin(box, shape, room_to_move(box, self.plan.window.size))
            # off frame 0, its points may be anywhere near
            points = with_margin(box, shape, grid.step) if self._at_frame_0 else near
            if grid.within(*points, origin=near) is None or not self._has_points(number):
                continue
            found = self._in_part(number, near, points, start)
            if near != self._everywhere and found.share_failed > FAILED:
                far = points if self._at_frame_0 else self._everywhere
                again = self._in_part(number, self._everywhere, far, start)
                if again.share_failed < found.share_failed:
                    found, points = again, far
            yield number, self._grid_in(points, points)[1], found

    def _has_points(self, number: int) -> bool:
        """Whether any grid point may lie on a body."""
        bodies, grid = self.reference.bodies, self.plan.grid
        assert bodies is not None
        return not self._at_frame_0 or bool((bodies.labels[np.ix_(grid.y, grid.x)] == number).any())

    def _grid_in(self, points: Part, part: Part) -> tuple[Grid, Part]:
        within = self.plan.grid.within(*points, origin=part)
        assert within is not None
        return within

    def _in_common(self) -> Start | None:
        """Search the motion of all bodies as one: a start for each; a body that it misses is searched by itself."""
        searched = self.guess is None and self.plan.search in ("auto", "pyramid")
        if not searched or not self._at_frame_0:
            return None
        still, _, moved, _ = self._frames(None, self._everywhere, self.plan.grid)
        if still.valid.size and not still.valid.any():
            return None
        return Start(pyramid(still, moved, self.plan.grid, self.plan.of_search))

    def _in_part(self, number: int | None, part: Part, points: Part, start: Start | None) -> Solution:
        """Measure one body (None: all that the mask leaves) in a part of the frames, at the grid points of another."""
        plan = self.plan.replace(shape=_shape_of(part))
        grid, places = self._grid_in(points, part)
        still, asked, moved, light = self._frames(number, part, grid)
        if number is None:
            masks = self.reference.bodies is not None, self.masks_move and self.moved.bodies is not None
            _require_pixels(asked, moved, masks)
        known = None if start is None else start.of(number, places, grid)
        guess = None if self.guess is None else self.guess[(slice(None), *places)]
        if plan.reference == "second":
            # frame 1 is the one that stays: frame 0 is found from it, backwards
            known = None if known is None else known.backwards()
            guess = None if guess is None else -placed(guess, grid, 1.0)
            backwards = plan.replace(reference="first")
            body = Body(moved, still, moved, grid, backwards, light, self.changed)
            found = body.measure(known, guess)
            found = found.replace(maps=-found.maps)
        else:
            body = Body(still, moved, asked, grid, plan, light, self.changed)
            found = body.measure(known, guess)
        masked = masked_points(found.maps, grid, asked.valid, plan.reference)
        return found.replace(flag=np.where(masked, FLAGS["masked"], found.flag).astype(np.uint16))

    def _frames(
        self, number: int | None, part: Part, grid: Grid
    ) -> tuple[Frame, Frame, Frame, BodyLight | None]:
        """Frame 0 where it counts for a body, frame 0 where that is asked for, and frame 1 where it may be; and what
        divides out the light of the body in frame 1.
        """
        reference, moved, plan = self.reference, self.moved, self.plan
        asked, other, light = reference.frame.part(part), moved.frame.part(part), None
        bodies, there = reference.bodies, moved.bodies if self.masks_move else None
        if bodies is not None:
            asked = asked.within(_where(bodies.of_number(number, part), asked))
        if there is not None:
            # the region of the settings is that of frame 0: what moves out of it is still there
            other = other.within(_where((there.whole or there).of_number(self._partner(number), part), other))
        if plan.lighting == "local":
            carries = bodies is not None and there is None
            carried = (grid, plan.reference == "second") if carries else None
            asked, other, light = body_lit(asked, other, plan.window.sigma, carried=carried)
        still = asked
        if bodies is not None and bodies.clear is not None:
            still = asked.within(both_valid(asked.valid, bodies.clear[part]))
        return reference.evidence(still, part), asked, moved.evidence(other, part), light

    def _partner(self, number: int | None) -> int | None:
        """Number of a body in frame 1; None for any, where the numbers are not given in both frames."""
        named = [one.bodies is not None and one.bodies.named for one in (self.reference, self.moved)]
        return number if all(named) else None


def _where(region: NDArray[np.uint8], frame: Frame) -> NDArray[np.uint8]:
    """Where a frame is valid in a region; `NO_MASK` where that is everywhere."""
    valid = both_valid(region, frame.valid)
    return NO_MASK if valid.all() else valid


def _require_pixels(asked: Frame, other: Frame, masked: tuple[bool, bool]) -> None:
    """Require both frames to have values where their masks, if they have any, are True."""
    masks = ("mask", "frame 0"), ("mask of the second frame", "that")
    for k, (frame, (which, name)) in enumerate(zip((asked, other), masks, strict=True)):
        if frame.valid.size and not frame.valid.any():
            raise BadFrameError(
                f"{which} is True only where {name} has no value (NaN or infinite): nothing is left to measure"
                if masked[k]
                else f"frame{k} has no content where the other frame has: all of its pixels have one value, or none"
            )


def _shape_of(part: Part) -> tuple[int, int]:
    rows, columns = part
    return rows.stop - rows.start, columns.stop - columns.start
