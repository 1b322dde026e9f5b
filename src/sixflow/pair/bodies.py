"""Bodies: every body of a pair measured by itself, in a part of the frames that leaves room for its motion."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sixflow.convention.flags import FLAGS
from sixflow.maps.grid import Grid
from sixflow.maps.placing import masked_points, placed
from sixflow.pair.body import Body
from sixflow.pair.start import Start
from sixflow.plan import Plan
from sixflow.prepare.frame import both_valid
from sixflow.refine.solution import Part, Solution, assembled
from sixflow.search.pyramid import pyramid

if TYPE_CHECKING:
    from sixflow.pair.result import Prepared
    from sixflow.pair.session import Session

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
class Bodies:
    """The bodies of a prepared pair of frames, and how they are measured.

    Attributes
    ----------
    session : Session
    reference, moved : Prepared
    plan : Plan
        With the lighting that was found for this pair.
    """

    session: Session
    reference: Prepared
    moved: Prepared
    plan: Plan

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
        searched = self.session.guess is None and self.plan.search in ("auto", "pyramid")
        if not searched or not self._at_frame_0:
            return None
        assert self.reference.bodies is not None
        everything = self.reference.bodies.of_number(None, self._everywhere)
        frame = self.reference.frame.within(both_valid(everything, self.reference.frame.valid))
        frame = self.reference.evidence(frame, self._everywhere)
        if not frame.valid.any():
            return None
        other = self.moved.evidence(self.moved.frame, self._everywhere)
        return Start(pyramid(frame, other, self.plan.grid, self.plan.of_search))

    def _in_part(self, number: int | None, part: Part, points: Part, start: Start | None) -> Solution:
        """Measure one body (None: all that the mask leaves) in a part of the frames, at the grid points of another."""
        plan, session = self.plan.replace(shape=_shape_of(part)), self.session
        grid, places = self._grid_in(points, part)
        still, asked, moved = session._frames_of(self.reference, self.moved, number, part)
        known = None if start is None else start.of(number, places, grid)
        guess = None if session.guess_maps is None else session.guess_maps[(slice(None), *places)]
        light = session._light(self.reference, self.moved, number, part, grid)
        doubtful = session.asked.lighting == "auto" and plan.lighting == "gain+offset"
        if plan.reference == "second":
            # frame 1 is the one that stays: frame 0 is found from it, backwards
            known = None if known is None else known.backwards()
            backwards = plan.replace(reference="first")
            guess = None if guess is None else -placed(guess, grid, 1.0)
            found = Body(moved, still, moved, grid, backwards, light, doubtful).measure(known, guess)
            found = found.replace(maps=-found.maps)
        else:
            found = Body(still, moved, asked, grid, plan, light, doubtful).measure(known, guess)
        masked = masked_points(found.maps, grid, asked.valid, plan.reference)
        return found.replace(flag=np.where(masked, FLAGS["masked"], found.flag).astype(np.uint16))


def _shape_of(part: Part) -> tuple[int, int]:
    rows, columns = part
    return rows.stop - rows.start, columns.stop - columns.start
