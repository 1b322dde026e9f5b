"""The figures of the paper, drawn from the code: `sixflow operators`.

After R. Eagleson, *Measurement of Motion-Induced Image Deformations*. Figure 2, the projection of a scene, shows no
operator and is left out.

| module | holds |
|---|---|
| `deformations` | figures 1 and 3: the six deformations and their trajectories |
| `quadrature` | figure 4: responses of a quadrature pair against shift |
| `kernels` | figures 5, 6 and 8 to 11: even and odd operators |
| `maps` | figure 7, and the hyperbolic maps that the paper lacks |
| `look` | colours and axes |
| `catalogue` | all figures with titles, formulas, captions, notes |
| `page` | one HTML page of them |
| `writing` | the files |
"""

from sixflow.gallery.catalogue import CATALOGUE as CATALOGUE
from sixflow.gallery.catalogue import Entry as Entry
from sixflow.gallery.writing import PAGE as PAGE
from sixflow.gallery.writing import write_gallery as write_gallery
