"""Maps: local affine maps at the points of a grid.

| module | what |
|---|---|
| `grid` | points on whole pixels |
| `placing` | maps expressed at the points of another frame |
| `neighbours` | what the maps around a point predict for it: outliers, filling, curvature |
| `six` | maps ↔ the six numbers |
| `motion` | a measured motion as a step of a trajectory |
| `restriction` | maps of a group of fewer parameters than the affine |
"""
