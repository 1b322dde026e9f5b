"""Recording: which frames of a recording are compared, and how the motions of pairs are joined."""
