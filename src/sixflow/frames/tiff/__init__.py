"""TIFF: one page or many, BigTIFF, ImageJ and OME stacks, packed bits, read by tifffile picture by picture.

| module | what it is for |
|---|---|
| `chain` | the directories of the file, as far as they go |
| `series` | a stack of pictures, and where each lies |
| `stacks` | the stacks of a file: described, of special programs, or plain pages |
| `described` | stacks that OME, ImageJ or tifffile describe |
| `ome`, `imagej` | what these two write about pictures, pixels and times |
| `page` | one picture, checked and decoded |
| `colour` | what its samples mean |
| `file` | the frames of the file |
"""

from sixflow.frames.tiff.file import TiffFile as TiffFile

__all__ = ["TiffFile"]
