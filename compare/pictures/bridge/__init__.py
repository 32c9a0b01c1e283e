"""Pictures of the studies of :mod:`compare.bridge`, a file for each."""
