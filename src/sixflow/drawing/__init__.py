"""Drawing: the look of all figures, and pictures of arrays; nothing here knows a field, a bank or a scene.

| module | what |
|---|---|
| `look` | sizes, colours, axes without ornament |
| `saving` | a figure becomes a file |
| `kernels` | complex kernels, side by side |
| `trajectories` | panels of trajectories |
| `flows` | panels of arrows over a frame |
"""
