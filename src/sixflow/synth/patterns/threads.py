"""Work on many points, shared out over threads (the work itself releases Python's lock)."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_CHUNK = 1 << 14  # points per task: the working arrays stay in the cache


def over_parts(task: Callable[[slice], None], count: int) -> None:
    """Call task(part) for slices that cover range(count), at the same time where there are several."""
    parts = [slice(first, first + _CHUNK) for first in range(0, count, _CHUNK)]
    if len(parts) <= 1:
        for part in parts:
            task(part)
        return
    with ThreadPoolExecutor(min(os.cpu_count() or 1, 8)) as pool:
        list(pool.map(task, parts))
