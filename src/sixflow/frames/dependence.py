"""Dependence: the frames of a video in the order in which they are shown, each with what makes it unusable.

A frame that is predicted from others inherits their damage, whatever its decoder says: of codecs that predict, all that
is decoded after a damaged frame is bad until the next key frame, and so are the frames that are shown before that key
frame. Frames that no other is predicted from take nothing with them.
"""

from __future__ import annotations

import collections
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sixflow.frames.decoder import decoded
from sixflow.frames.packets import Packets

_MISSING = "it could not be decoded: its data is damaged, or frames that it needs are missing"


def frames_as_shown(path: Path, packets: Packets) -> Iterator[tuple[Any, str]]:
    """Yield every frame of a video as it is shown, and what is wrong with it.

    Yields
    ------
    frame : av.VideoFrame or None
        None where there is none.
    damage : str
        Empty if nothing is wrong.
    """
    places = collections.defaultdict[int, collections.deque[int]](collections.deque)
    for place, number in enumerate(packets.shown):
        places[number].append(place)
    chain = _Chain(packets, {number: place[0] for number, place in places.items()})
    waiting: dict[int, Any] = {}
    known, done = (
        0,
        0,
    )  # places before `known` have a frame or will never have one; those before `done` are yielded
    for number, frame, damage in decoded(path, packets.in_order):
        chain.tell(number, damage)
        if frame is not None and places[number]:
            place = places[number].popleft()
            for other in range(known, place):
                if other not in waiting:
                    chain.tell(packets.shown[other], _MISSING)
            known = max(known, place + 1)
            if place >= done:
                waiting[place] = frame
        while done < known and chain.is_settled(packets.shown[done]):
            yield _told(waiting.pop(done, None), chain.damage[packets.shown[done]])
            done += 1
    for place in range(done, len(packets.shown)):
        if place not in waiting:
            chain.tell(packets.shown[place], _MISSING)
    chain.finish()
    for place in range(done, len(packets.shown)):
        yield _told(waiting.pop(place, None), chain.damage[packets.shown[place]])


def _told(frame: Any, damage: str) -> tuple[Any, str]:
    return frame, damage or ("" if frame is not None else _MISSING)


class _Chain:
    """Follows the packets in the order of decoding, and passes damage on from each to those that need it."""

    def __init__(self, packets: Packets, places: dict[int, int]) -> None:
        self.damage: dict[int, str] = {}
        self._packets, self._places = packets, places
        self._told: dict[int, str] = {}
        self._next = 0
        self._broken: int | None = None  # place of the damaged frame that others may need
        self._before: tuple[int, int] | None = (
            None  # place of the key frame since then, and of the damaged frame
        )

    def tell(self, number: int, damage: str) -> None:
        """Take in what is known of a packet; what is said first counts."""
        self._told[number] = self._told.get(number) or damage
        shown = self._places
        while self._next < len(self._packets.in_order) and (
            self._next in self._told or self._next not in shown
        ):
            self._follow(self._next, self._told.get(self._next, ""))
            self._next += 1

    def is_settled(self, number: int) -> bool:
        """Whether all that a packet may depend on is known."""
        return number < self._next

    def finish(self) -> None:
        """Take what was not reported damaged for whole."""
        while self._next < len(self._packets.in_order):
            self._follow(self._next, self._told.get(self._next, ""))
            self._next += 1

    def _follow(self, number: int, damage: str) -> None:
        packet, place = self._packets.in_order[number], self._places.get(number, -1)
        if packet.is_key and self._broken is not None:
            self._before, self._broken = (place, self._broken), None
        needed = self._broken
        if needed is None and self._before is not None and not packet.is_key and place < self._before[0]:
            needed = self._before[1]
        if damage and not packet.is_disposable and not self._packets.intra_only:
            self._broken = self._broken if self._broken is not None else place
        if not damage and needed is not None:
            damage = f"it is predicted from frame {needed}, which is damaged" if needed >= 0 else _MISSING
        self.damage[number] = damage
