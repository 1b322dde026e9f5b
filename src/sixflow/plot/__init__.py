"""Plots of a field, for papers: one call for everything (`plot_field`), or the parts on axes of your own."""

from sixflow.plot.arrows import plot_arrows as plot_arrows
from sixflow.plot.figure import plot_field as plot_field
from sixflow.plot.glyphs import plot_glyphs as plot_glyphs
from sixflow.plot.maps import plot_map as plot_map
