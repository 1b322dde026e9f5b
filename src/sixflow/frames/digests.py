"""Digests of the frames of a recording, by which a resumed measurement knows that they are what they were."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from sixflow.errors import InputError
from sixflow.frames.bad import BadFrame

Frame = TypeVar("Frame")


class FrameDigests:
    """Digests of frames, in the order in which they are read.

    Parameters
    ----------
    known : sequence of str
        Of the frames that have been measured before.

    Attributes
    ----------
    known : list of str
        Of those and of all that have been read since.

    Examples
    --------
    >>> first = FrameDigests()
    >>> _ = list(first.watch([np.zeros((2, 2)), np.ones((2, 2))]))
    >>> again = FrameDigests(first.known)
    >>> list(again.watch([np.zeros((2, 2)), np.full((2, 2), 5.0)]))
    Traceback (most recent call last):
    sixflow.errors.InputError: frame 1: is not the frame that was measured before the interruption; ...
    """

    def __init__(self, known: Sequence[str] = ()) -> None:
        self.known = list(known)

    def watch(
        self, frames: Iterable[Frame], name_of: Callable[[int], str] = "frame {}".format
    ) -> Iterator[Frame]:
        """Yield the frames from the first on, comparing those that are known and remembering the others.

        Raises InputError if a frame differs from the one that was read before, or there are fewer.

        Parameters
        ----------
        frames : iterable
            Arrays, or `BadFrame`, all of which are alike.
        name_of : callable
            The name of a frame from its place, for messages.
        """
        before, count = len(self.known), 0
        for count, frame in enumerate(frames, start=1):
            digest = frame_digest(frame)
            if count > len(self.known):
                self.known.append(digest)
            elif self.known[count - 1] != digest:
                raise InputError(
                    f"{name_of(count - 1)}: is not the frame that was measured before the interruption; "
                    "put that back, or begin again with overwrite=True (--overwrite)"
                )
            yield frame
        if count < before:
            raise InputError(
                f"frames: there are {count}, but {before} were measured before the interruption; "
                "give all of them, or begin again with overwrite=True (--overwrite)"
            )


def frame_digest(frame: object) -> str:
    """Return a digest of the values, shape and type of a frame; that of any `BadFrame` is the same."""
    if isinstance(frame, BadFrame):
        return "bad"
    array = np.asanyarray(frame)
    if array.dtype.hasobject:
        return "no numbers"
    digest = hashlib.sha256(f"{array.dtype.str} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).data)
    if isinstance(array, np.ma.MaskedArray):
        digest.update(np.ma.getmaskarray(array).tobytes())
    return digest.hexdigest()[:16]
