"""Frames: one reader for image files, stacks, folders, patterns, videos and arrays.

`open_frames` returns a `FrameSource`, which yields grey frames one at a time. Each kind of file has one
module; `formats` tells which, by the file's suffix, and imports it when the first such file is read.
"""

from sixflow.frames.bad import BadFrame as BadFrame
from sixflow.frames.metadata import Compression as Compression
from sixflow.frames.metadata import Metadata as Metadata
from sixflow.frames.opening import open_frames as open_frames
from sixflow.frames.selection import Selection as Selection
from sixflow.frames.source import FrameSource as FrameSource

__all__ = ["BadFrame", "Compression", "FrameSource", "Metadata", "Selection", "open_frames"]
