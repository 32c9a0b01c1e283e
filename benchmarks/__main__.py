"""All benchmarks, or those named: `python -m benchmarks [pours] [lattice] [continuum] ...`."""

import sys
from importlib import import_module

SUBJECTS = ("pours", "lattice", "continuum", "solvers", "grains")

for subject in sys.argv[1:] or SUBJECTS:
    if subject not in SUBJECTS:
        sys.exit(f"{subject}: no such benchmark; there are {', '.join(SUBJECTS)}")
    module = import_module(f"benchmarks.{subject}")
    print(f"\n== {subject}: {module.__doc__.splitlines()[0]}")
    module.main()
