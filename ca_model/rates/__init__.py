"""The rate rule: the continuum's law of capture and amplification, grain by grain, at random."""
