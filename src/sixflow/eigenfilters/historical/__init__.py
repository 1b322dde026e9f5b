"""Historical operators: what was there before the eigenfilters, small and faithful, to compare with.

| function | route to the six | source |
|---|---|---|
| `gradient_ratio` | each generator alone: its ratio of spatio-temporal gradients | Narathong et al. |
| `fleet_jepson` | phase of Gabor pairs → component velocities → affine fit | Fleet & Jepson 1990 |
| `differentiated_flow` | flow of two components, then its differences | Longuet-Higgins & Prazdny 1980; Kanatani 1985 |

Each returns a `HistoricalField`. The convention is that of `sixflow.convention`: I1(x + u) = I0(x), x right, y
down.
"""

from sixflow.eigenfilters.historical.differences import differentiated_flow as differentiated_flow
from sixflow.eigenfilters.historical.phase import fleet_jepson as fleet_jepson
from sixflow.eigenfilters.historical.ratios import gradient_ratio as gradient_ratio
from sixflow.eigenfilters.historical.result import HistoricalField as HistoricalField
