"""The lattice rule on arrays: `packets` below a source at rest, `steps` below one that moves."""
