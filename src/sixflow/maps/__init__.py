"""Maps: local affine maps at the points of a grid.

| module | what |
|---|---|
| `grid` | points on whole pixels |
| `placing` | maps expressed at the points of another frame |
| `restriction` | maps of a group of fewer parameters than the affine |
"""
