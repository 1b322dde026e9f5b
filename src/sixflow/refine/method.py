"""Method: which kind of pass a setting asks for."""

from __future__ import annotations

from sixflow.refine.passes import Passes
from sixflow.settings import Settings


def passes_of(settings: Settings) -> type[Passes]:
    """Return the class of `settings.method`; what it needs is loaded when it is asked for."""
    if settings.method == "eigenfilter":
        from sixflow.eigenfilters.passes import EigenfilterPasses

        return EigenfilterPasses
    return Passes
