"""Every error that sixflow raises on purpose, in one small tree.

A message names the argument, the value that was seen, and what to do about it.

```
SixflowError
├── InputError (ValueError)      an argument, a frame, a mask, a setting cannot be used
│   └── BadFrameError            a frame of a recording; the others can be used
├── FrameFileError (OSError)     a file of frames is missing, unreadable, truncated or of unknown type
├── FieldFileError (OSError)     a field cannot be written or read back
└── MeasurementError             a measurement was possible to start but nothing could be measured
```
"""


class SixflowError(Exception):
    """Root of all errors raised by sixflow."""


class InputError(SixflowError, ValueError):
    """An argument cannot be used; the message names it, its value and the remedy."""


class BadFrameError(InputError):
    """A frame cannot be used, though others of its recording can: constant, without a value, a copy of another."""


class FrameFileError(SixflowError, OSError):
    """A file, folder or pattern of frames cannot be read; the message names it and the remedy."""


class FieldFileError(SixflowError, OSError):
    """A field cannot be written to, or read from, the path that the message names."""


class MeasurementError(SixflowError, RuntimeError):
    """The frames are usable but nothing in them could be measured."""
