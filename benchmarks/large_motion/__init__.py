"""Large motion about points at one scale, without a pyramid, from the correlation of canonical maps: a study."""
